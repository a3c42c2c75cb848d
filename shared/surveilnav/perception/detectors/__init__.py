"""Detectors: a file a family.

coco        COCO's classes, by ONNX networks that have to agree: ``yolox``, ``deimv2``, ``picodet``
onnx_file   what those share

Any word, by PyTorch (``make test-torch``): ``grounding_dino`` (and ``spans``, its words), ``omdet_turbo``, ``owlv2``;
``queries`` is what these share, ``word_length`` says which words are too long for one.
"""
