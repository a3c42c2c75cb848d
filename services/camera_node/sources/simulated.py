"""A camera in a simulated building: its views are rendered, or read from the cache of rendered views."""

from __future__ import annotations

from collections.abc import Sequence

from surveilnav.camera_plan import PlannedCamera
from surveilnav.geometry import Pose
from surveilnav.messages import StreamStatus
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.camera_node.sources.source import Picture, Place
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M, SimulatedBuilding


class SimulatedSource:
    """A ``Source``: one camera of a simulated building's camera plan."""

    def __init__(self, building: SimulatedBuilding, camera: PlannedCamera) -> None:
        plan = building.plan
        self._building, self._camera = building, camera
        self._labels = building.scene.truth_labels
        self.place = Place(camera.name, camera.floor, camera.position_m, plan.mounting_offset_m)
        self.views: Sequence[Pose] = camera.views
        self.intrinsics = plan.intrinsics
        self.depth_range_m = CAMERA_DEPTH_RANGE_M
        self.has_depth = True
        self.stream = StreamStatus()

    def version(self, view: int) -> int | None:
        """Always 0: a rendered building doesn't change."""
        return 0

    def content(self, view: int) -> str:
        """A hash of all that the picture of a view depends on: scene, pose of the view and rendering settings."""
        return self._building.camera_content(self._camera, view)

    def latest(self, view: int) -> Picture:
        """The view with its instance ids."""
        rendered = self._building.camera_view(self._camera, view)
        truth = TrueInstances(rendered.instance_ids, self._labels, self.views[view].matrix())
        return Picture(0, rendered.rgb, rendered.depth_m, truth)
