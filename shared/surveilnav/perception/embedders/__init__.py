"""Embedders, which turn pictures, objects and texts into unit vectors of one space.

``class_space`` serves detectors of COCO's classes, ``clip`` any word.
"""
