"""Searches beside one camera whose description is wrong: when that is noticed, and what it costs.

    python -m surveilnav.benchmark.studies.bad_cameras data/objectnav --split val_mini --scenes 3_bedroom_attic-s0 flats_0-s0

The first table has every camera of these buildings by itself, without a robot: how many are noticed by the floor that their views
show. Then searches are played (``--searches 0``: none). In each, the camera nearest to the start is described wrongly in one of
eight ways. Beside them, the same searches are played with that camera as it is, and without it. A camera that is noticed is taken
out of the maps by provenance, since the benchmark keeps no log (``services.fusion.core.removal``).
``--mistakes`` plays only some.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import mean, median

import numpy as np

from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.load import SceneData, load_scene, start_of
from surveilnav.benchmark.play.cameras import InvokedCameras
from surveilnav.benchmark.play.episode import EpisodeResult
from surveilnav.benchmark.play.sight import SeenView, Sight
from surveilnav.benchmark.runner.play import seed_of
from surveilnav.benchmark.runner.search import search, sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.views.quarantine import Quarantine
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.simulator.truth.choose import choose_backend

#: A wrong description of a view; None: the view isn't sent.
Mistake = Callable[[PosedView], PosedView | None]


def _turned(axis: int, deg: float) -> Matrix4:
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    T = np.eye(4)
    i, j = [k for k in range(3) if k != axis]
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def _with_pose(change: Callable[[Matrix4], Matrix4]) -> Mistake:
    return lambda view: replace(view, T_world_camera=change(view.T_world_camera))


def _turned_about_itself(axis: int, deg: float) -> Mistake:
    """The camera was turned about an axis of the world after it had been described."""

    def change(T: Matrix4) -> Matrix4:
        out = T.copy()
        out[:3, :3] = _turned(axis, deg)[:3, :3] @ T[:3, :3]
        return out

    return _with_pose(change)


def _moved(x_m: float, z_m: float) -> Mistake:
    def change(view: PosedView) -> PosedView:
        T = view.T_world_camera.copy()
        T[0, 3] += x_m
        T[2, 3] += z_m
        return replace(view, T_world_camera=T, mounting_offset_m=view.mounting_offset_m + z_m)

    return change


def _with_focal_length(factor: float) -> Mistake:
    def change(view: PosedView) -> PosedView:
        c = view.camera
        lens = Pinhole(c.width_px, c.height_px, c.fx_px * factor, c.fy_px * factor, c.cx_px, c.cy_px)
        return replace(view, camera=lens)

    return change


def _in_millimetres(view: PosedView) -> PosedView:
    low, high = view.depth_range_m
    return replace(view, depth_m=view.depth_m * np.float32(1000), depth_range_m=(1000 * low, 1000 * high))


MISTAKES: Mapping[str, Mistake] = {
    "as it is": lambda view: view,
    "without it": lambda view: None,
    "half its focal length": _with_focal_length(0.5),
    "twice its focal length": _with_focal_length(2.0),
    "depth in millimetres": _in_millimetres,
    "axes of OpenGL": _with_pose(lambda T: T @ np.diag([1.0, -1.0, -1.0, 1.0])),
    "leans by 4 degrees": _turned_about_itself(0, 4.0),
    "turned by 10 degrees": _turned_about_itself(2, 10.0),
    "30 cm too high": _moved(0.0, 0.3),
    "50 cm beside": _moved(0.5, 0.0),
}

#: By what yaw [deg], x and y [m] must be changed to undo a mistake that shows in what others have measured.
CORRECTIONS = {"turned by 10 degrees": (-10.0, 0.0, 0.0), "50 cm beside": (0.0, -0.5, 0.0)}
#: A correction is right within these.
_RIGHT_DEG, _RIGHT_M = 1.5, 0.12


class OneBadCamera(InvokedCameras):
    """The cameras of a search, one of which is described wrongly. ``n_sent``: how many of its views have come."""

    def __init__(self, sight: Sight, settings: RunSettings, bad: str, mistake: Mistake) -> None:
        super().__init__(sight, settings.fusion_config(), 0, 0)
        self._bad, self._mistake = f"camera/{bad}", mistake
        self.n_sent = 0

    def in_turn(self, joint: JointMap, seen: SeenView, arrived: tuple[str, ...]) -> Iterator[SeenView]:
        for one in super().in_turn(joint, seen, arrived):
            if one.view.source != self._bad:
                yield one
            elif (view := self._mistake(one.view)) is not None:
                if not self._is_known(joint):
                    self.n_sent += 1
                yield SeenView(view, one.perception, one.offered_bytes)

    def _is_known(self, joint: JointMap) -> bool:
        return self._bad in joint.quarantine.reasons()


@dataclass
class Row:
    """What came of the searches with one mistake.

    Attributes:
        camera_views: of the searches in which the bad camera was noticed, how many of its views had come.
        robot_views: ... and how many of the robot's.
        n_false: how many other cameras were put into quarantine.
        errors: of the corrections that were said, by how much yaw [deg] and place [m] were wrong.
    """

    results: list[EpisodeResult] = field(default_factory=list)
    camera_views: list[int] = field(default_factory=list)
    robot_views: list[int] = field(default_factory=list)
    n_false: int = 0
    errors: list[tuple[float, float]] = field(default_factory=list)

    def record_correction(self, name: str, found: tuple[float, ...]) -> None:
        yaw_deg, x_m, y_m = CORRECTIONS[name]
        error_m = math.hypot(found[1] - x_m, found[2] - y_m)
        self.errors.append((abs(math.degrees(found[0]) - yaw_deg), error_m))

    def text(self, name: str) -> str:
        n = len(self.results)
        noticed = f"{len(self.robot_views)} of {n}" if name not in ("as it is", "without it") else "–"
        after = "–"
        if self.robot_views:
            after = f"{median(self.camera_views):.0f} | {median(self.robot_views):.0f}"
        success, spl = (mean(getattr(r.verdict, what) for r in self.results) for what in ("success", "spl"))
        corrected = "–"
        if name in CORRECTIONS:
            n_right = sum(deg <= _RIGHT_DEG and metres <= _RIGHT_M for deg, metres in self.errors)
            corrected = f"{len(self.errors)}, {n_right} rightly"
        after = after if after != "–" else "– | –"
        return f"| {name} | {noticed} | {after} | {corrected} | {self.n_false} | {success:.0%} | {spl:.2f} |"


HEADER = (
    "| the nearest camera | noticed | after so many of its views | of the robot's | corrected | others accused "
    "| success | SPL |\n"
    "|---|---|---|---|---|---|---|---|"
)


def play(data: SceneData, sight: Sight, settings: RunSettings, n_searches: int, rows: Mapping[str, Row]) -> None:
    """Plays a scene's first searches with each mistake."""
    building = sight.building
    for episode in data.content.episodes[:n_searches]:
        label, start = data.label_of(episode), start_of(episode, building.scene)
        goals = data.goals(label, building.scene, building.navigation)
        x_m, y_m, _ = start.p_m
        here = [info for info in sight.infos if info.floor == start.floor]
        bad = min(here, key=lambda info: math.dist((x_m, y_m), info.views[0].T_world_camera.matrix()[:2, 3])).camera
        for name, row in rows.items():
            mistake, noticed, accused = MISTAKES[name], list[int](), set[str]()
            found: dict[str, tuple[float, ...]] = {}
            cameras = OneBadCamera(sight, settings, bad, mistake)

            def on_step(step: int, view: PosedView, joint: JointMap, *_: object) -> None:
                reasons = joint.quarantine.reasons()
                if f"camera/{bad}" in reasons and not noticed:  # noqa: B023 (called within this turn of the loop)
                    noticed.append(view.seq)  # noqa: B023
                accused.update(reasons)  # noqa: B023
                found.update(joint.quarantine.corrections())  # noqa: B023

            seed = seed_of(settings.seed, data.record.scene, episode.episode_id)
            row.results.append(
                search(sight, settings, goals, start, seed=seed, goal_on_floor=True, cameras=cameras, on_step=on_step)
            )
            if name in CORRECTIONS and f"camera/{bad}" in found:
                row.record_correction(name, found[f"camera/{bad}"])
            row.robot_views += noticed
            row.camera_views += [cameras.n_sent] * len(noticed)
            row.n_false += len(accused - ({f"camera/{bad}"} if name != "as it is" else set()))


FLOOR_HEADER = (
    "| each camera by itself | noticed by its floor | after so many views, median | at most |\n|---|---|---|---|"
)


def noticed_by_floor(sight: Sight, mistake: Mistake) -> list[int | None]:
    """For each camera, after how many of its views it is put into quarantine; None: never."""
    out: list[int | None] = []
    for info in sight.infos:
        quarantine = Quarantine(ValidationConfig())
        after = None
        for k, seen in enumerate(sight.camera(info.camera), 1):
            view = mistake(seen.view)
            with contextlib.suppress(ViewError):
                quarantine.check(view or seen.view)
            after = after or (k if quarantine.reasons() else None)
        out.append(after)
    return out


def floor_row(name: str, after: list[int | None]) -> str:
    known = [n for n in after if n is not None]
    views = f"{median(known):.0f} | {max(known)}" if known else "– | –"
    return f"| {name} | {len(known)} of {len(after)} | {views} |"


def main() -> None:
    parser = argparse.ArgumentParser(prog="bad_cameras", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--split", default="val_mini")
    parser.add_argument("--scenes", nargs="+", required=True)
    parser.add_argument("--searches", type=int, default=3, help="so many of each scene")
    parser.add_argument("--mistakes", nargs="+", choices=MISTAKES, default=list(MISTAKES), metavar="MISTAKE")
    args = parser.parse_args()
    settings, began_s = RunSettings(split=args.split), time.monotonic()
    rows = {name: Row() for name in args.mistakes}
    by_floor: dict[str, list[int | None]] = {name: [] for name in args.mistakes if name != "without it"}
    for scene in args.scenes:
        data = load_scene(args.root, args.split, scene)
        building = open_scene(data.record, lighting="flat")
        sight = sight_of(building, choose_backend("simulated"), settings, plan=data.plan(settings.density_m2))
        for name, after in by_floor.items():
            after += noticed_by_floor(sight, MISTAKES[name])
        play(data, sight, settings, args.searches, rows)
        print(f"{scene}: {len(sight.infos)} cameras, {time.monotonic() - began_s:.0f} s", flush=True)
    print(FLOOR_HEADER)
    for name, after in by_floor.items():
        print(floor_row(name, after))
    if args.searches:
        print(f"\n{HEADER}")
        for name, row in rows.items():
            print(row.text(name))


if __name__ == "__main__":
    main()
