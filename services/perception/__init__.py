"""Perception on request: a small inference server for detections, masks and embeddings, with NVIDIA Triton's semantics.

service          answers queries on the bus; the backends themselves are in ``surveilnav.perception``
inference        handles requests about views: checks, cache, admission, reply
pending_request  one such request while it is processed
stage_pipeline   runs the backend's stages, each on threads of its own, in batches
embedding        the last stage and text embeddings, which share the backend
reply_cache      replies to earlier requests, in memory and on disk
truth_channel    instance ids for the two backends that a simulator tells the truth
core/            the decisions: queueing, checks, cache keys, the probe picture
"""
