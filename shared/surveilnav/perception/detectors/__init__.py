"""Detectors: a file a family.

coco        COCO's classes, by ONNX networks that have to agree: ``yolox``, ``deimv2``, ``picodet``
onnx_file   what those share
"""
