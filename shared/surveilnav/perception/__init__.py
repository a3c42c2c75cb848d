"""The backends of perception, pure: arrays in, arrays out.

backend      the protocol ``Backend``
choose       which one runs, and why
onnx_coco    the real one: ``detectors`` that must agree (``boxes``), ``masks``, embeddings (``closed_set``)
weights      the networks' files: where they come from, and their hashes
prompts      the text that the value map compares views with (eq. 2)
sizes, class_priors   what is known of classes by name
"""

from surveilnav.perception.backend import Backend

__all__ = ["Backend"]
