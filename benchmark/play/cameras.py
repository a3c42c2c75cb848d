"""Which views of the cameras come to the maps, and when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from surveilnav.benchmark.play.sight import SeenView, Sight
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import FusionConfig, JointMap, active_cameras
from surveilnav.services.fusion.core.views.order import ViewFootprint, highest_first


class Cameras(Protocol):
    """The cameras of a search, asked once a step."""

    @property
    def offered_bytes(self) -> Mapping[str, int]:
        """By camera that was invoked, the bytes of its views."""

    @property
    def n_pending(self) -> int:
        """How many views of the cameras of the robot's floor the maps don't hold yet."""

    def invoke(self, floor_z_m: float, now: int) -> tuple[str, ...]:
        """Invokes the cameras of the robot's floor at step ``now``; the names of those whose views have come since."""

    def in_turn(self, joint: JointMap, seen: SeenView, arrived: tuple[str, ...]) -> Iterator[SeenView]:
        """This step's views in the order in which the maps take them, the robot's (``seen``) among them. ``arrived``: what
        ``invoke`` said. Each is taken before the next is asked for."""


class InvokedCameras:
    """Invokes cameras (eq. 1), and knows which of their views are still to come. ``offered_bytes``: by camera invoked."""

    def __init__(self, sight: Sight, config: FusionConfig, delay_steps: int, views_per_step: int) -> None:
        self._sight, self._tau_z_m, self._range_m = sight, config.map.tau_z_m, config.map.explored_range_camera_m
        self._delay_steps, self._views_per_step = delay_steps, views_per_step
        self.offered_bytes: dict[str, int] = {}
        self._due: list[tuple[int, tuple[str, ...]]] = []
        self._waiting: dict[tuple[str, int], tuple[ViewFootprint, SeenView]] = {}  # by source and view
        self._here: tuple[str, ...] = ()  # the cameras of the robot's floor

    def invoke(self, floor_z_m: float, now: int) -> tuple[str, ...]:
        self._here = tuple(active_cameras([floor_z_m], self._sight.infos, self._tau_z_m))
        if new := tuple(name for name in self._here if name not in self.offered_bytes):
            self.offered_bytes |= {name: sum(v.offered_bytes for v in self._sight.camera(name)) for name in new}
            self._due.append((now + self._delay_steps, new))
        arrived = tuple(name for at, names in self._due if at <= now for name in names)
        self._due = [(at, names) for at, names in self._due if at > now]
        return arrived

    @property
    def n_pending(self) -> int:
        due = {name for _, names in self._due for name in names}
        return len(self._waiting_here()) + sum(len(self._sight.camera(name)) for name in self._here if name in due)

    def in_turn(self, joint: JointMap, seen: SeenView, arrived: tuple[str, ...]) -> Iterator[SeenView]:
        """What perception has time for of the cameras' views, those that may show most first; then the robot's."""
        self._wait(arrived)
        x_m, y_m, _ = seen.view.T_world_camera[:3, 3].tolist()
        yield from self._looked_at(joint, (x_m, y_m, seen.view.floor_z_m))
        yield seen

    def _wait(self, names: tuple[str, ...]) -> None:
        for name in names:
            for seen in self._sight.camera(name):
                self._waiting[seen.view.source, seen.view.view] = self._footprint(seen.view), seen

    def _looked_at(self, joint: JointMap, robot_m: tuple[float, float, float]) -> list[SeenView]:
        """The views that perception has time for until the robot's next, those that may show most first."""
        keys = self._waiting_here()
        n = self._views_per_step or len(keys)
        if n < len(keys):
            order = highest_first(joint.view_utilities([self._waiting[key][0] for key in keys], [robot_m]))
            keys = [keys[k] for k in order]
        return [self._waiting.pop(key)[1] for key in keys[:n]]

    def _waiting_here(self) -> list[tuple[str, int]]:
        """Source and view of those of the robot's floor: nobody looks at another's while it is away."""
        here = {f"camera/{name}" for name in self._here}
        return [key for key in self._waiting if key[0] in here]

    def _footprint(self, view: PosedView) -> ViewFootprint:
        return ViewFootprint.from_view(view.T_world_camera, view.camera, view.floor_z_m, self._range_m)
