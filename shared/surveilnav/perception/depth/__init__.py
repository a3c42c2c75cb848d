"""Depth from the picture of a calibrated camera that has no depth sensor.

``DepthNetwork`` is a small network of our own, trained on rendered views (training/depth/README.md). ``FittedDepth``
runs a network of others, such as Depth Anything V2, and fits its scale and shift to the floor that the camera sees.
"""

from surveilnav.perception.depth.estimate import DepthEstimate, DepthEstimator
from surveilnav.perception.depth.network import DepthNetwork
from surveilnav.perception.depth.reference import Reference, reference_depth

__all__ = ["DepthEstimate", "DepthEstimator", "DepthNetwork", "Reference", "reference_depth"]
