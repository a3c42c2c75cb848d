"""Depth from the picture of a calibrated camera that has no depth sensor.

``DepthNetwork`` is a small network of our own, trained on rendered views (training/depth/README.md).
"""

from surveilnav.perception.depth.network import DepthEstimate, DepthNetwork
from surveilnav.perception.depth.reference import Reference, reference_depth

__all__ = ["DepthEstimate", "DepthNetwork", "Reference", "reference_depth"]
