"""Segmenters: which pixels of a box are the object. ``depth_in_box`` asks depth alone; ``mobile_sam`` (ONNX, or PyTorch)
and ``sam2`` (PyTorch) are networks told boxes, and share ``box_prompts``."""
