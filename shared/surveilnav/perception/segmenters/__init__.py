"""Segmenters, which find the pixels of a box that belong to the object.

``depth_in_box`` uses depth only. ``mobile_sam`` (ONNX or PyTorch) and ``sam2`` (PyTorch) are networks that take boxes as
prompts; ``box_prompts`` is what they share.
"""
