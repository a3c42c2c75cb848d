"""Perception on request: a small server of detectors, masks and embeddings, with Triton's semantics over Zenoh.

service         answers queries; the backends themselves are in ``surveilnav.perception``
views           the way of one view: checked, remembered or let in, answered
line            the stages, each on threads of its own, in batches
embedding       the last stage and the embeddings of texts, which take turns
truth_channel   instance ids for the two backends that a simulator tells the truth
core/           who waits, who goes first, who is turned away, what is kept
"""
