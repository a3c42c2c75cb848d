"""One surveillance camera: encodes and publishes the views of its source while somebody listens.

sources/         where the pictures come from: the protocol ``Source``, streams, the simulator, and one that hides mask zones
zones            the file of mask zones, and which pixels they hide
frames           encodes views, each version once
result_cache     what was computed from simulated views, kept on disk between runs
service          publishes the views that are due, answers requests
edge_perception  runs a detector in the camera itself, for its summary
real, simulated  run a camera of cameras.yaml, and one of a simulated building
taking, lease    find a camera for this process
core             the decisions: which views to send, what the summary says, how a stream is doing
"""
