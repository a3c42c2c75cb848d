"""A made-up run in a made-up flat: what a report is written of."""

from __future__ import annotations

import itertools
import math
from datetime import UTC, datetime

import cv2
import numpy as np

from surveilnav.cli.report.record import DecidingView, MapMoment, RunRecord, Step, TrafficLine
from surveilnav.geometry import Grid, Pinhole, Pose, camera_pose
from surveilnav.messages import CameraInfo, CameraViewInfo, Candidate, MissionStatus, ObjectEvent, ObjectRecord, Plan


def make_camera(name: str, x_m: float, y_m: float, azimuths: range = range(0, 360, 30)) -> CameraInfo:
    """13 views, or fewer: those of ``azimuths`` [degrees] at -30 degrees, and one straight down."""
    at = (x_m, y_m, 1.8)
    views = [
        CameraViewInfo(i, Pose.from_matrix(camera_pose(at, math.radians(a), -math.pi / 6)))
        for i, a in enumerate(azimuths)
    ]
    views.append(CameraViewInfo(12, Pose.from_matrix(camera_pose(at, 0.0, -math.pi / 2))))
    return CameraInfo(
        stamp_ns=1,
        camera=name,
        floor="0",
        position_m=at,
        mounting_offset_m=1.8,
        intrinsics=Pinhole.from_hfov(1280, 1280, math.radians(100)),
        views=views,
    )


def _layers() -> dict[str, tuple[Grid, np.ndarray]]:
    """A flat of 11 x 7 m with two inner walls, half explored."""
    grid = Grid(-6.0, -6.0, 0.05, 480, 480)
    y, x = np.mgrid[0:480, 0:480] * 0.05 - 6.0 + 0.025
    inside = (x > -0.1) & (x < 11.1) & (y > -0.1) & (y < 7.1)
    walls = inside & ~((x > 0.1) & (x < 10.9) & (y > 0.1) & (y < 6.9))
    walls |= inside & (abs(x - 5.0) < 0.06) & ~((y > 2.0) & (y < 3.0))
    walls |= inside & (abs(y - 4.0) < 0.06) & (x > 5) & ~((x > 8.0) & (x < 9.0))
    walls |= ((x - 2.2) ** 2 + (y - 5.2) ** 2 < 0.6) | ((abs(x - 9.8) < 0.35) & (abs(y - 6.2) < 0.35))
    explored = inside & ~walls & ~((x < 5) & (y > 4.6) & (x < 1.5))
    frontier = inside & ~walls & (x < 5) & (abs(x - 1.55) < 0.05) & (y > 4.6)
    value = np.where(explored, 0.2 + 0.5 * np.exp(-((x - 9.5) ** 2 + (y - 5.8) ** 2) / 8), np.nan).astype(np.float32)
    as_bytes = {"occupancy": walls, "explored": explored, "frontier": frontier}
    return {name: (grid, cells.astype(np.uint8)) for name, cells in as_bytes.items()} | {"value": (grid, value)}


def _moments(n: int) -> list[MapMoment]:
    """The flat as it gets known, a sweep from west to east."""
    layers = _layers()
    grid, explored = layers["explored"]
    x = np.mgrid[0:480, 0:480][1] * 0.05 - 6.0
    moments = []
    for seq in range(0, n, 3):
        known = x < 11.1 * (seq + 3) / n
        packed = MapMoment.pack(explored * known, layers["occupancy"][1] * known)
        moments.append(MapMoment(seq, "0", grid, packed))
    return moments


def _walked(way: list[tuple[float, float]]) -> list[Step]:
    picture, path_m, steps = _picture(1), 0.0, []
    for i, (x, y) in enumerate(way):
        before = way[max(0, i - 1)]
        path_m += math.dist(before, (x, y))
        yaw = math.atan2(y - before[1], x - before[0])
        steps.append(Step(x, y, "0", i, i, 0.8 * i, yaw, path_m, "move_forward", False, picture))
    return steps


def _picture(seed: int) -> bytes:
    height, width = 480, 640
    y, x = np.mgrid[0:height, 0:width]
    picture = np.stack([180 - y / 6, 175 - y / 8 + x / 40, 170 - y / 10 + 10 * seed], axis=-1).astype(np.uint8)
    cv2.rectangle(picture, (300, 180), (390, 400), (70, 120, 60), -1)
    cv2.rectangle(picture, (60, 250), (230, 430), (120, 100, 150), -1)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def _object(
    id: int, label: str, status: str, confidence: float, x_m: float, y_m: float, reason: str, **more: object
) -> ObjectRecord:
    history = [
        ObjectEvent(10, "camera/c2", 3, 1, label, confidence - 0.1, "created", "new: nothing near overlaps"),
        ObjectEvent(31, "robot/r1", 0, 31, label, confidence, "matched", "s = 1.62 >= 1.35"),
        ObjectEvent(32, "robot/r1", 0, 32, label, confidence, status if status != "candidate" else "matched", reason),  # type: ignore[arg-type]
    ]
    facts: dict[str, object] = {
        "id": id,
        "floor": "0",
        "label": label,
        "status": status,
        "confidence": confidence,
        "confidence_robot": confidence,
        "confidence_surveillance": confidence - 0.1,
        "label_robot": label,
        "label_surveillance": label,
        "n_detections": 3,
        "n_points": 420,
        "center_m": (x_m, y_m, 0.4),
        "size_m": (0.6, 0.6, 0.9),
        "first_seen_ns": 1,
        "last_seen_ns": 3,
        "sources": ["camera/c2", "robot/r1"],
        "reason": reason,
        "history": history,
    }
    return ObjectRecord(**(facts | more))  # type: ignore[arg-type]


def made_up_run() -> RunRecord:
    """A search of 42 steps for a potted plant, which camera c2 saw first."""
    corners = [(1.0, 1.0), (4.0, 1.2), (5.5, 2.5), (8.4, 2.8), (8.6, 4.6), (9.1, 5.3)]
    way: list[tuple[float, float]] = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        n = max(1, round(math.hypot(x1 - x0, y1 - y0) / 0.25))
        way += [(x0 + (x1 - x0) * i / n, y0 + (y1 - y0) * i / n) for i in range(n)]
    way.append(corners[-1])
    waypoint = Candidate("target", 9.8, 6.2, 0.82, True, "confirmed potted plant #4", 4)
    frontier = Candidate("frontier", 1.5, 5.0, 0.31, False, "further")
    plans = [
        Plan(
            stamp_ns=1,
            mission="m",
            robot="r1",
            floor="0",
            step=i,
            seq=i,
            action="move_forward",
            path_m=[way[i], way[-1]],
            waypoint=waypoint if i > 20 else Candidate("frontier", 5.0, 2.5, 0.4, True, "best value over way"),
            candidates=[frontier],
        )
        for i in range(len(way))
    ]
    return RunRecord(
        building="SweetHome3DExample2",
        seed=3,
        target="potted plant",
        perception="onnx-coco",
        perception_why="weights found: DEIMv2 and YOLOX",
        surveillance=True,
        started=datetime(2025, 5, 4, 12, 30, tzinfo=UTC),
        seconds=48.2,
        status=MissionStatus(
            stamp_ns=1,
            mission="m",
            target="potted plant",
            robot="r1",
            state="done",
            phase="stopped",
            step=len(way) - 1,
            max_steps=500,
            path_m=11.9,
            floor="0",
            found=True,
            object_id=4,
            message="confirmed by camera c2 and robot r1",
        ),
        verdict={
            "found": True,
            "success": True,
            "steps": len(way) - 1,
            "spl": 0.87,
            "path_m": 11.9,
            "shortest_path_m": 10.4,
            "distance_to_viewpoint_m": 0.06,
        },
        trajectory=_walked(way),
        plans=plans,
        layers={"0": _layers()},
        map_moments=_moments(len(way)),
        room="Living room",
        cameras=[
            make_camera("c1", 2.5, 2.0),
            make_camera("c2", 8.2, 5.6, range(-30, 120, 30)),
            make_camera("c3", 7.5, 1.2),
            make_camera("c4", 1.2, 5.8),
        ],
        invoked=["c1", "c2", "c3"],
        objects=[
            _object(4, "potted plant", "confirmed", 0.82, 9.8, 6.2, "0.82 >= 0.50, seen by both"),
            _object(7, "potted plant", "rejected", 0.55, 2.2, 5.2, "class flipped to vase"),
            _object(2, "couch", "candidate", 0.7, 6.0, 6.0, ""),
            _object(3, "chair", "candidate", 0.6, 6.5, 1.0, ""),
        ],
        deciding_views=[
            DecidingView(
                "camera c2, view 1: first saw it",
                _picture(0),
                [(300, 180, 390, 400, "potted plant", 0.72), (60, 250, 230, 430, "couch", 0.66)],
            ),
            DecidingView(
                "robot r1, step 41: confirmed it",
                _picture(2),
                [(300, 180, 390, 400, "potted plant", 0.82)],
            ),
        ],
        traffic=[
            TrafficLine("c1", "camera", 5_300_000, 5_300_000, 5_310_000),
            TrafficLine("c2", "camera", 2_900_000, 2_900_000, 2_905_000),
            TrafficLine("c3", "camera", 4_800_000, 4_790_000, 4_800_000),
            TrafficLine("c4", "camera", 2_100, 900, 4_000),
            TrafficLine("r1", "robot", 9_800_000, 9_800_000, 9_810_000),
            TrafficLine("fusion", "service", 20_100_000, 23_000_000, 20_150_000),
            TrafficLine("perception w1", "service", 900_000, 19_000_000, None),
        ],
        notes=["Run on 2 CPU cores."],
    )
