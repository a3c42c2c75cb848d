"""Detectors, one file per model family.

coco        COCO's classes, by several ONNX networks: ``yolox``, ``deimv2``, ``picodet``
compact     our own network, with ``depth_channels`` (its depth input) and ``guided_mask`` (its masks)
yolo_world  a user's ONNX file, with the words that it was exported with
onnx_file   sessions of ONNX Runtime

Open vocabulary, under PyTorch (``make test-torch``): ``grounding_dino`` (with ``spans``, the words in its text),
``omdet_turbo``, ``owlv2``. ``queries`` holds what these share, ``word_length`` finds words that are too long for them.
"""
