"""The depth network under ONNX Runtime: depth from one picture of a camera without a depth sensor, whose pose is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.perception.depth.estimate import FLOOR_CHANCE, MAX_SIGMA_LOG, DepthEstimate
from surveilnav.perception.depth.reference import FARTHEST_M, reference_channels, reference_depth
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.runtime import Runtime

#: The network in this package.
BUILT_IN = Path(__file__).parents[1] / "data" / "depth" / "depth.onnx"
#: Metadata entry of its files, and its value. A change of inputs or outputs changes the value.
FORMAT_KEY, FORMAT = "surveilnav_depth", "1"
INPUTS, OUTPUTS = ("picture", "geometry"), ("log_ratio", "sigma_log", "floor")
#: Length of the input's longer side, and what both sides are multiples of. Inputs of the geometry and outputs have half of it.
_SIDE_PX, _MULTIPLE_PX, _OUTPUT_STRIDE = 256, 32, 2


class DepthNetwork:
    """The network in an ONNX file that ``training.depth.export`` wrote.

    Args:
        path: the file; None: the one in this package.
        runtime: device and number of threads; None: one thread of the CPU.

    Raises:
        PerceptionError: the file isn't there, or is no such network.
    """

    def __init__(self, path: Path | None = None, runtime: Runtime | None = None) -> None:
        path = path or BUILT_IN
        if not path.is_file():
            raise PerceptionError(f"there is no file {path} for the depth network; training/depth/README.md makes one")
        self._session = open_session(path, runtime or Runtime(device="cpu"))
        found = self._session.get_modelmeta().custom_metadata_map.get(FORMAT_KEY)
        names = {one.name for one in [*self._session.get_inputs(), *self._session.get_outputs()]}
        if found != FORMAT or not names.issuperset((*INPUTS, *OUTPUTS)):
            raise PerceptionError(
                f"{path.name} is no depth network of this version: expected inputs {', '.join(INPUTS)}, outputs "
                f"{', '.join(OUTPUTS)} and {FORMAT_KEY} = {FORMAT} in its metadata; it has {', '.join(sorted(names))} "
                f"and {found}. python -m training.depth.export writes such a file"
            )

    def estimate(
        self, rgb: NDArray[np.uint8], camera: Pinhole, T_world_camera: Matrix4, floor_z_m: float
    ) -> DepthEstimate:
        """See ``DepthEstimator.estimate``."""
        height, width = camera.height_px, camera.width_px
        if rgb.shape != (height, width, 3) or rgb.dtype != np.uint8:
            raise PerceptionError(
                f"the depth network needs a picture (H, W, 3) uint8 of its camera's {width} x {height} pixels, "
                f"got {rgb.shape} {rgb.dtype}"
            )
        small = input_size(width, height)
        grid = camera.resized(small[0] // _OUTPUT_STRIDE, small[1] // _OUTPUT_STRIDE)
        geometry = reference_channels(reference_depth(grid, T_world_camera, floor_z_m), grid)
        shrinks = small[0] < width or small[1] < height
        picture = cv2.resize(rgb, small, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        log_ratio, sigma_log, floor = (
            cv2.resize(out, (width, height), interpolation=cv2.INTER_LINEAR)
            for out in self._session.run(OUTPUTS, {"picture": picture[None], "geometry": geometry[None]})
        )
        # The reference is computed at full resolution, so that the floor stays a plane.
        depth_m = reference_depth(camera, T_world_camera, floor_z_m).depth_m
        depth_m = depth_m * np.where(floor > FLOOR_CHANCE, np.float32(1.0), np.exp(log_ratio))
        unknown = (sigma_log > MAX_SIGMA_LOG) | (depth_m > FARTHEST_M)
        depth_m = np.where(unknown, np.float32(0.0), depth_m).astype(np.float32)
        return DepthEstimate(depth_m, sigma_log.astype(np.float32), floor.astype(np.float32))


def input_size(width_px: int, height_px: int) -> tuple[int, int]:
    """(width, height) of the network's input for a picture: the longer side 256, both multiples of 32."""
    ratio = _SIDE_PX / max(width_px, height_px)
    width, height = (max(1, int(side * ratio / _MULTIPLE_PX + 0.5)) * _MULTIPLE_PX for side in (width_px, height_px))
    return width, height
