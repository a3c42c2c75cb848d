"""Perception on request: detector, masks and embeddings behind one interface.

service         answers queries, one view at a time; the backends themselves are in ``surveilnav.perception``
truth_channel   instance ids for the two backends that a simulator tells the truth
"""
