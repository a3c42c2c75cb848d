"""Perception on request: detector, masks and embeddings behind one interface."""
