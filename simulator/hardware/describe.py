"""``python -m surveilnav.simulator.hardware.describe FOLDER``: writes the files that describe a simulated building's hardware.

They are what an integrator would write: ``building.yaml``, ``cameras.yaml`` and ``robots/r1.yaml``. Where the cameras hang and
where the robot's map lies is known exactly, as to somebody with a tape measure.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import yaml

from surveilnav.bus.main import run_service
from surveilnav.simulator.hardware import fisheye
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.robot_start import start_state
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.storage import atomic_write


def cameras_file(building: SimulatedBuilding, rtsp: str) -> dict[str, Any]:
    """``cameras.yaml``. ``rtsp``: where the cameras listen, such as rtsp://127.0.0.1:8554."""
    floors = {
        name: {
            "z_m": round(ground.z_m, 4),
            "rooms": {r.name: [list(c) for c in r.polygon_m] for r in building.scene.rooms if r.floor == name},
        }
        for name, ground in building.navigation.floors.items()
    }
    side_px = fisheye.SIDE_PX
    cameras = [
        {
            "name": camera.name,
            "floor": camera.floor,
            "stream": f"{rtsp}/{camera.name}",
            "position_m": [round(float(v), 4) for v in camera.position_m],
            "yaw_deg": 0.0,
            "pitch_deg": -90.0,
            "views": "around",
            "lens": {"model": "fisheye", "width_px": side_px, "height_px": side_px, "hfov_deg": fisheye.HFOV_DEG},
        }
        for camera in building.plan.cameras
    ]
    return {"building": building.plan.building, "floors": floors, "cameras": cameras}


def robot_file(building: SimulatedBuilding, settings: RobotHardwareSettings) -> dict[str, Any]:
    """``robots/r1.yaml``."""
    floor = start_state(building, settings.start, settings.start_for).floor
    return {
        "router": settings.router,
        "domain": settings.domain,
        "namespace": settings.namespace,
        "floor": floor,
        "floor_z_m": round(building.navigation.floors[floor].z_m, 4),
        "T_building_map": {"x_m": settings.map_x_m, "y_m": settings.map_y_m, "yaw_deg": settings.map_yaw_deg},
        "depth_range_m": [settings.depth_min_m, settings.depth_max_m],
        **({"topics": {"scan": "scan"}} if settings.scanner else {}),
    }


def main() -> None:
    """Writes the files."""
    parser = argparse.ArgumentParser(prog="python -m surveilnav.simulator.hardware.describe", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rtsp", default="rtsp://127.0.0.1:8554", help="where the cameras listen")
    args = parser.parse_args()
    building = SimulatedBuilding(SimulationSettings())
    written = {
        "cameras.yaml": cameras_file(building, args.rtsp),
        "robots/r1.yaml": robot_file(building, RobotHardwareSettings()),
        "building.yaml": {
            "building": building.plan.building,
            "cameras": "cameras.yaml",
            "robots": {"r1": "robots/r1.yaml"},
        },
    }
    for name, content in written.items():
        path = args.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as out:
            out.write(yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode())
    print(f"{args.folder / 'building.yaml'} describes {len(building.plan.cameras)} cameras and a robot", flush=True)


if __name__ == "__main__":
    sys.exit(run_service(main))
