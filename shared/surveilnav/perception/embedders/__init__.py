"""Embedders: pictures, boxes and texts as unit vectors of one space. ``class_space`` serves detectors with a vocabulary,
``clip`` any word."""
