"""RTSP streams of a simulated building's cameras: rendered, with a sensor's noise, encoded to H.264."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import NamedTuple

import cv2
import numpy as np
import yaml

from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from tests import streams

SIDE_PX, HFOV_DEG = 640, 100.0
_SEGMENT, _FPS = 20, 5
#: A building, and the views of its camera that see a tv.
BUILDING, VIEWS = "parametric_flat", [("c0-1", 8), ("c0-1", 2)]


class Streams(NamedTuple):
    """A building's RTSP streams, and the process that serves them."""

    building: SimulatedBuilding
    address: str
    server: Popen[bytes]

    def cameras_yaml(self) -> str:
        """The file that describes them."""
        return cameras_yaml(self.building, VIEWS, self.address)


@contextmanager
def served(folder: Path, host: str = "127.0.0.1") -> Iterator[Streams]:
    """Renders ``VIEWS`` of ``BUILDING`` into a folder and serves them at ``host``."""
    building = SimulatedBuilding(SimulationSettings(building=BUILDING, cameras=1))
    building.prepare()
    write_streams(building, VIEWS, folder)
    with streams.rtsp_server(folder, host) as (address, server):
        yield Streams(building, address, server)


def write_streams(
    building: SimulatedBuilding, views: Sequence[tuple[str, int]], folder: Path, seconds: float = 600.0
) -> dict[str, Path]:
    """A video of each (camera, view) of the building's plan, by the name ``<camera>v<view>``."""
    made = {}
    for camera_name, view in views:
        camera = building.plan.camera(camera_name)
        assert camera is not None
        rgb = building.camera_view(camera, view).rgb
        still = cv2.resize(rgb, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA).astype(np.float32)
        name = f"{camera_name}v{view}"
        made[name] = streams.write_looped_video(folder / f"{name}.mp4", noisy(still, _SEGMENT), seconds, _FPS)
    return made


def noisy(still: np.ndarray, n: int) -> list[np.ndarray]:
    """n pictures of one scene as a sensor sees it."""
    rng = np.random.default_rng(int(still.sum()) % 2**31)
    return [np.clip(still + rng.normal(0.0, 3.0, still.shape), 0, 255).astype(np.uint8) for _ in range(n)]


def cameras_yaml(building: SimulatedBuilding, views: Sequence[tuple[str, int]], address: str) -> str:
    """The file that describes these streams. It knows where the cameras are, as somebody with a tape measure would."""
    floors, cameras = {}, []
    for camera_name, view in views:
        camera = building.plan.camera(camera_name)
        assert camera is not None
        T = camera.views[view].matrix()
        floors[camera.floor] = {
            "z_m": round(camera.position_m[2] - building.plan.mounting_offset_m, 3),
            "rooms": {
                room.name: [list(corner) for corner in room.polygon_m]
                for room in building.scene.rooms
                if room.floor == camera.floor
            },
        }
        cameras.append(
            {
                "name": f"{camera_name}v{view}",
                "floor": camera.floor,
                "stream": f"{address}/{camera_name}v{view}.mp4",
                "position_m": [round(float(v), 3) for v in camera.position_m],
                "yaw_deg": round(math.degrees(math.atan2(T[1, 2], T[0, 2])), 2),
                "pitch_deg": round(math.degrees(math.asin(T[2, 2])), 2),
                "lens": {"width_px": SIDE_PX, "height_px": SIDE_PX, "hfov_deg": HFOV_DEG},
            }
        )
    return yaml.safe_dump({"building": building.plan.building, "floors": floors, "cameras": cameras}, sort_keys=False)
