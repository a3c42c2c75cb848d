"""Segmenters, which find the pixels of a box that belong to the object.

``depth_in_box`` uses depth only. ``mobile_sam`` (ONNX or PyTorch) and ``sam2`` (PyTorch) are networks that take boxes as
prompts; ``box_prompts`` is what they share.
"""

#: Error message if the packages for a checkpoint of MobileSAM are missing; formatted with its name and the error.
MISSING_PACKAGES = (
    "{} needs the packages mobile_sam, timm, torch and torchvision ({}): pip install "
    "'surveilnav[perception-torch,mobile-sam]', or take another segmenter: SURVEILNAV_PERCEPTION__SEGMENTER=sam2.1-tiny"
)
