"""One surveillance camera: encodes and publishes the views of its source while somebody listens.

sources/         where the pictures come from: the protocol ``Source``, the simulated one, and one that hides mask zones
zones            the file of mask zones, and which pixels they hide
frames           encodes views, each version once
result_cache     what was computed from simulated views, kept on disk between runs
service          publishes the views that are due, answers requests
edge_perception  runs a detector in the camera itself, for its summary
slots            leases a camera of the plan to this process
core             the decisions: which views to send, what the summary says
"""
