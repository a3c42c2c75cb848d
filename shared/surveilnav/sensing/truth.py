"""Encodes and decodes the instance ids of simulated views. Data from the network is checked: ``WireError``."""

from __future__ import annotations

import numpy as np

from surveilnav.errors import WireError
from surveilnav.geometry import Pose
from surveilnav.messages import Truth
from surveilnav.sensing.limits import MAX_PIXELS
from surveilnav.sensing.packing import MAX_LABEL_CHARS, pack_array, unpack_array
from surveilnav.sensing.views import TrueInstances


def truth_to_wire(truth: TrueInstances, *, source: str, view: int, seq: int, stamp_ns: int) -> tuple[Truth, bytes]:
    """Encodes the instance ids of the view (source, view, seq) as message and payload."""
    height_px, width_px = truth.ids.shape
    pose = Pose.from_matrix(truth.T_world_camera) if truth.T_world_camera is not None else None
    message = Truth(
        stamp_ns=stamp_ns,
        source=source,
        view=view,
        seq=seq,
        width_px=width_px,
        height_px=height_px,
        labels=truth.labels,
        T_world_camera=pose,
    )
    return message, pack_array(truth.ids)


def truth_from_wire(truth: Truth, packed: bytes) -> TrueInstances:
    """Decodes the instance ids in a message and its payload.

    Raises:
        WireError: sizes or labels make no sense, or the payload doesn't decode.
    """
    if truth.width_px < 1 or truth.height_px < 1 or truth.width_px * truth.height_px > MAX_PIXELS:
        raise WireError(f"instance ids of {truth.width_px}x{truth.height_px} pixels make no sense")
    if any(not 1 <= id_ <= 65535 or len(label) > MAX_LABEL_CHARS for id_, label in truth.labels.items()):
        raise WireError(f"labels of instance ids go from 1 to 65535, with at most {MAX_LABEL_CHARS} characters each")
    pose = truth.T_world_camera.matrix() if truth.T_world_camera is not None else None
    return TrueInstances(unpack_array(packed, np.uint16, (truth.height_px, truth.width_px)), dict(truth.labels), pose)
