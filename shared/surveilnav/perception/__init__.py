"""The backends of perception, pure: arrays in, arrays out.

backend      the class ``Backend``: the stages that a view passes through
protocols    its three parts: ``Detector``, ``Segmenter``, ``Embedder``
pipeline     a backend made of the three
names        what backends are called
presets      which three make which backend; ``choose`` takes one, and says why
detectors, segmenters, embedders   the parts, a file a model; ``parts`` takes one by its model's name
torch_model  what runs under PyTorch is loaded by it; runtime: on which device, with how many threads
vocabulary   the names of a closed set of classes, and what is known of them (``data``)
models       the networks' files: where they come from, and that they are what they should be
boxes        boxes with the scores of words; sizes: what depth says of a label
prompts      the text that the value map compares views with (eq. 2), and targets that a backend can't look for
"""
