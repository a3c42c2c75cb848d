"""Perception backends: RGB-D pictures in, detections with masks and embeddings out. Pure, no input or output.

backend         the interface ``Backend``: the stages that a view passes through
protocols       the interfaces ``Detector``, ``Segmenter``, ``Embedder``
pipeline        a backend made of these three
single_network  a backend of one network: ``compact``
names           names of the backends
presets         the backends by name, and their models; ``choose`` picks one, and says why
detectors, segmenters, embedders   one file per model family; ``parts`` loads one by its model's name
torch_model     loads models under PyTorch; runtime: device and threads
vocabulary      the names of a closed set of classes, and prior knowledge about them (``data``)
models          the networks' files: where they come from, and their checksums
boxes           boxes with the scores of words; sizes: plausible sizes of classes
chances         calibration: from a score to a probability
prompts         the text that the value map compares views with (eq. 2)
"""
