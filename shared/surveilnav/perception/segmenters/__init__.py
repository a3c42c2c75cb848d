"""Segmenters: which pixels of a box are the object. ``depth_in_box`` asks depth alone."""
