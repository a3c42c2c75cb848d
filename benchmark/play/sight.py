"""The views that fusion would get of a simulated building: rendered for the robot and the cameras, with perception's answers.

Two ways. ``pixels``: rendered with light, through the encoders of the bus and back, so the bytes are those that a camera
would offer and a detector sees what JPEG left. ``depth``: for perception that is told the truth and looks at no pixel:
depth and instance ids alone, at a fraction of the resolution; a camera's bytes are those that were measured once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.play.depth_error import DepthError
from surveilnav.bus.wire import encode
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.contract import CAMERA_FRAME, CAMERA_SUMMARY, ROBOT_OBSERVATION
from surveilnav.geometry import Matrix4, Pinhole, Pose
from surveilnav.messages import (
    PERCEIVED_TIERS,
    CameraInfo,
    CameraSummary,
    CameraViewInfo,
    FrameHeader,
    InferReply,
    ModelIds,
    Tier,
)
from surveilnav.perception.backend import Backend
from surveilnav.perception.depth.network import DepthNetwork
from surveilnav.robot_body import CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.robot_state import RobotState
from surveilnav.sensing.packing import decode_frame, pack_embedding, unpack_embedding
from surveilnav.sensing.perceived import perceived_reply
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.tiers import Seen, encode_view
from surveilnav.sensing.views import PosedView, TrueInstances, ViewPerception, looks_straight_down, measured_depth_m
from surveilnav.services.camera_node.core.summary import ViewLabels, build_summary, merge_labels
from surveilnav.services.robot_node.bodies.body import Observation
from surveilnav.services.robot_node.observation import encode as encode_observation
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.picture import Rendered
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M, SimulatedBuilding, noise_seed
from surveilnav.simulator.world.labels import TARGETS

Way = Literal["pixels", "depth"]
Views = Literal["panoramic", "half"]
#: What cameras know of depth: what a sensor measures, what our network estimates, nothing, or the truth with ``DEPTH_ERRORS``.
CameraDepth = Literal["sensor", "network", "none", "estimate-5", "estimate-15"]
#: A cheap sensor or a good network, and a network that doesn't know its scale.
DEPTH_ERRORS = {"estimate-5": DepthError(0.05, 0.04), "estimate-15": DepthError(0.15, 0.06)}
#: By camera, what each of its views takes on the wire.
ViewBytes = Mapping[str, Sequence[int]]

_BUILDING = "building"
ROBOT = "r1"
_ROBOT_JPEG_QUALITY = 90
#: Width of the pictures that are rendered for the depth network where perception looks at none.
_ESTIMATION_PX = 256


@dataclass(frozen=True, slots=True)
class SeenView:
    """A view as it arrives, what perception says of it, and the bytes that its sender offered (0: not counted)."""

    view: PosedView
    perception: ViewPerception | None
    offered_bytes: int


def _as_sent(seen: ViewPerception, view: PosedView, models: ModelIds) -> ViewPerception:
    """What fusion understands of a worker's reply about ``view``: on its way an embedding is rounded."""
    detections, image_embedding = perception_to_wire(seen)
    reply = InferReply(
        stamp_ns=0,
        worker="",
        backend=seen.backend,
        source=view.source,
        view=view.view,
        seq=view.seq,
        detections=detections,
        image_embedding=image_embedding,
        latency_ms=0.0,
        models=models,
        words=list(seen.words),
    )
    return perception_from_wire(reply, view.camera)


def text_as_sent(backend: Backend, text: str) -> NDArray[np.float32]:
    """The embedding (D,) of a text, as fusion gets it from a worker."""
    return unpack_embedding(pack_embedding(backend.embed_texts([text])[0]))


@dataclass(frozen=True, slots=True)
class PoseError:
    """Every camera was surveyed wrongly by this much, in a direction and about an axis drawn for it."""

    position_m: float = 0.0
    angle_rad: float = 0.0

    def drawn(self, camera: str, seed: int) -> Matrix4:
        """A camera's error (4, 4): its views are turned by its rotation about the camera, and moved by its translation."""
        rng = np.random.default_rng(noise_seed(seed, "pose error", camera))
        axis, direction = rng.normal(size=(2, 3))
        turn, _ = cv2.Rodrigues(self.angle_rad * axis / np.linalg.norm(axis))
        error = np.eye(4)
        error[:3, :3], error[:3, 3] = turn, self.position_m * direction / np.linalg.norm(direction)
        return error


NO_POSE_ERROR = PoseError()
NOT_MEASURED: ViewBytes = {}


def _frame(
    rendered: Rendered,
    camera: PlannedCamera,
    index: int,
    said: Pose,
    plan: CameraPlan,
    *,
    tier: Tier = "jpeg+depth",
    seen: Seen | None = None,
) -> tuple[FrameHeader, bytes, int]:
    """A camera's view as it goes over the bus: header, payload, and the bytes of both and of the key."""
    encoded = encode_view(
        tier, rendered.rgb, rendered.depth_m, plan.intrinsics, depth_range_m=CAMERA_DEPTH_RANGE_M, seen=seen
    )
    header = FrameHeader(
        stamp_ns=0,
        source=f"camera/{camera.name}",
        view=index,
        seq=1,
        floor=camera.floor,
        T_world_camera=said,
        camera=plan.intrinsics,
        mounting_offset_m=plan.mounting_offset_m,
        depth_range_m=CAMERA_DEPTH_RANGE_M,
        image=encoded.image,
        depth=encoded.depth,
        depth_source="sensor" if encoded.has_depth else "none",
        tier=tier,
        perceived=encoded.perceived,
    )
    key = CAMERA_FRAME.key_for(building=_BUILDING, floor=camera.floor, camera=camera.name, view=index)
    return header, encoded.payload, len(encoded.payload) + len(encode(header)) + len(key)


def offered_views(building: SimulatedBuilding, plan: CameraPlan) -> dict[str, list[int]]:
    """By camera, the bytes that each of its views takes: rendered in the building's light, through the bus's encoders."""
    settings, noise = building.settings, DepthNoise.camera()
    offered: dict[str, list[int]] = {}
    for camera in plan.cameras:
        for index, pose in enumerate(camera.views):
            rendered = building.renderer.render(
                pose.matrix(),
                plan.intrinsics,
                depth_range_m=CAMERA_DEPTH_RANGE_M,
                noise=noise if settings.depth_noise else None,
                seed=noise_seed(settings.seed, camera.name, index),
            )
            offered.setdefault(camera.name, []).append(_frame(rendered, camera, index, pose, plan)[2])
    return offered


class Sight:
    """The eyes of one building. Camera views are made and perceived once: they don't change.

    Attributes:
        infos: the cameras as they announce themselves, with the views that they have.
    """

    def __init__(
        self,
        building: SimulatedBuilding,
        backend: Backend,
        *,
        plan: CameraPlan | None = None,
        views: Views = "panoramic",
        way: Way = "pixels",
        scale: int = 2,
        pose_error: PoseError = NO_POSE_ERROR,
        camera_depth: CameraDepth = "sensor",
        view_bytes: ViewBytes = NOT_MEASURED,
        words: Sequence[str] = TARGETS,
        camera_backend: Backend | None = None,
        camera_tier: Tier = "jpeg+depth",
    ) -> None:
        """``plan``: the building's own unless given. ``scale``: of ``depth``, full resolution divided by this.
        ``pose_error``: how wrong the cameras are about where they hang. ``camera_depth``: what
        the cameras' pictures have of depth. ``view_bytes``: of ``depth``, by camera what each
        of its views takes (``offered_views``). ``words``: what a detector with an open vocabulary looks for, the targets of
        all episodes, since views are perceived once. ``camera_backend``: what looks at the cameras' views; None: ``backend``.
        ``camera_tier``: how much the cameras send of them, of ``pixels``."""
        if way == "depth" and not backend.needs_truth:
            raise ValueError(f"{backend.name} looks at pixels: it needs way='pixels'")
        if way == "depth" and camera_tier != "jpeg+depth":
            raise ValueError(f"way='depth' sends no pictures: the tier {camera_tier} needs way='pixels'")
        self.building, self.backend, self.way = building, backend, way
        self._camera_backend = camera_backend or backend
        self._plan = plan or building.plan
        self._half, self._scale = views == "half", scale if way == "depth" else 1
        self._view_bytes, self._words, self._camera_depth = view_bytes, tuple(words), camera_depth
        self._tier: Tier = camera_tier
        self._error = {c.name: pose_error.drawn(c.name, building.settings.seed) for c in self._plan.cameras}
        self._cameras = {camera.name: camera for camera in self._plan.cameras}
        is_told = backend.needs_truth or self._camera_backend.needs_truth
        self._labels = building.scene.truth_labels if is_told else {}
        self.infos = [self._info(camera) for camera in self._plan.cameras]
        self.camera = lru_cache(maxsize=None)(self._camera)
        self.summary = lru_cache(maxsize=None)(self._summary)

    def robot(self, state: RobotState, seed: int = 0, believed: RobotState | None = None) -> SeenView:
        """What the robot sees at ``state``; ``seed`` sets the luck of its perception apart from other episodes'.

        ``believed``: where the robot believes to be, if that isn't where it is.
        """
        T_world_camera = state.camera_pose()
        T_believed = T_world_camera if believed is None else believed.camera_pose()
        key = (seed, f"robot/{ROBOT}", 0, state.seq) if seed else (f"robot/{ROBOT}", 0, state.seq)
        if self.way == "depth":
            rendered = self._depth(T_world_camera, CAMERA, DEPTH_RANGE_M, DepthNoise.robot(), "robot", state.seq)
            view = PosedView(
                f"robot/{ROBOT}",
                0,
                state.seq,
                state.seq,
                state.floor,
                T_believed,
                self._lens(CAMERA),
                CAMERA_HEIGHT_M,
                rendered.rgb,
                rendered.depth_m,
                DEPTH_RANGE_M,
            )
            return SeenView(view, self._perceive(view, rendered, key), 0)
        rendered = self.building.robot_view(T_world_camera, CAMERA, DEPTH_RANGE_M, state.seq)
        observed = Observation(
            believed or state, T_believed, CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M, rendered.rgb, rendered.depth_m
        )
        message, pictures = encode_observation(observed, ROBOT, _ROBOT_JPEG_QUALITY, stamp_ns=state.seq)
        address = ROBOT_OBSERVATION.key_for(building=_BUILDING, robot=ROBOT)
        view = decode_frame(message, pictures)
        offered_bytes = len(pictures) + len(encode(message)) + len(address)
        return SeenView(view, self._perceive(view, rendered, key), offered_bytes)

    def by_floor(self) -> dict[str, dict[str, float]]:
        """Floor -> label -> highest confidence that a camera of that floor reports."""
        floors: dict[str, dict[str, float]] = {}
        for info in self.infos:
            labels = floors.setdefault(info.floor, {})
            for label, confidence in self.summary(info.camera)[0].labels.items():
                labels[label] = max(confidence, labels.get(label, 0.0))
        return floors

    def _camera(self, name: str) -> tuple[SeenView, ...]:
        camera = self._cameras[name]
        return tuple(self._camera_view(camera, index) for index in self._indices(camera))

    def _summary(self, name: str) -> tuple[CameraSummary, int]:
        """What a camera reports of all its views, made by its own perception, and the bytes that it offers for it."""
        seen = {}
        for index, view in enumerate(self.camera(name)):
            labels: dict[str, float] = {}
            for detected in view.perception.detections if view.perception else ():
                labels[detected.label] = max(detected.confidence, labels.get(detected.label, 0.0))
            seen[index] = ViewLabels(1, labels)
        floor = self._cameras[name].floor
        message = build_summary(name, floor, merge_labels(seen), stamp_ns=0)
        key = CAMERA_SUMMARY.key_for(building=_BUILDING, floor=floor, camera=name)
        return message, len(encode(message)) + len(key)

    def _camera_view(self, camera: PlannedCamera, index: int) -> SeenView:
        lens, offset_m = self._plan.intrinsics, self._plan.mounting_offset_m
        source, pose = f"camera/{camera.name}", camera.views[index]
        said = self._said(camera.name, pose)
        if self.way == "depth":
            rendered = self._depth(pose.matrix(), lens, CAMERA_DEPTH_RANGE_M, DepthNoise.camera(), camera.name, index)
            view = PosedView(
                source,
                index,
                1,
                0,
                camera.floor,
                said.matrix(),
                self._lens(lens),
                offset_m,
                rendered.rgb,
                rendered.depth_m,
                CAMERA_DEPTH_RANGE_M,
            )
            measured = self._view_bytes.get(camera.name)
            offered = measured[index] if measured else 0
            view = self._as_known(view, pose)
            return SeenView(view, self._perceive(view, rendered, (source, index, 1)), offered)
        rendered = self.building.camera_view(camera, index)
        key = source, index, 1
        if self._tier not in PERCEIVED_TIERS:
            header, payload, offered = _frame(rendered, camera, index, said, self._plan, tier=self._tier)
            view = self._as_known(decode_frame(header, payload), pose)
            return SeenView(view, self._perceive(view, rendered, key), offered)
        seen = self._seen(self._camera_backend, rendered, lens, said.matrix(), key)
        header, payload, offered = _frame(rendered, camera, index, said, self._plan, tier=self._tier, seen=seen)
        view, reply = self._as_known(decode_frame(header, payload), pose), perceived_reply(header, payload)
        return SeenView(view, None if reply is None else perception_from_wire(reply, view.camera), offered)

    def _as_known(self, view: PosedView, pose: Pose) -> PosedView:
        """A camera's view with what is known of its depth. ``pose``: where the camera really hangs."""
        if self._camera_depth == "sensor":
            return view
        if self._camera_depth == "none":
            return replace(view, depth_m=np.zeros_like(view.depth_m), depth_source="none")
        if self._camera_depth == "network":
            return self._with_estimated_depth(view, pose)
        error = DEPTH_ERRORS[self._camera_depth]
        depth_m = error.apply(view.depth_m, noise_seed(self.building.settings.seed, view.source, view.view))
        return replace(view, depth_m=depth_m, depth_source="network", depth_uncertainty=error.uncertainty)

    @cached_property
    def _depth_network(self) -> DepthNetwork:
        return DepthNetwork()

    def _with_estimated_depth(self, view: PosedView, pose: Pose) -> PosedView:
        """A camera's view with the depth that our network makes of its picture, told the pose that the camera believes in."""
        lens = view.camera
        if self.way == "depth":  # there the view has no colours
            lens = lens.resized(_ESTIMATION_PX, _ESTIMATION_PX * lens.height_px // lens.width_px)
            rgb = self.building.renderer.render(
                pose.matrix(), lens, depth_range_m=CAMERA_DEPTH_RANGE_M, noise=None, seed=0
            ).rgb
        else:
            rgb = view.rgb
        depth_m, uncertainty = self._depth_network.estimate(rgb, lens, view.T_world_camera, view.floor_z_m).for_maps()
        size = view.camera.width_px, view.camera.height_px
        depth_m = np.asarray(cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST), np.float32)
        return replace(view, depth_m=depth_m, depth_source="network", depth_uncertainty=uncertainty)

    def _said(self, camera: str, pose: Pose) -> Pose:
        """Where a camera says that a view was taken from."""
        error, T = self._error[camera], pose.matrix()
        if (error == np.eye(4)).all():
            return pose
        T[:3, :3], T[:3, 3] = error[:3, :3] @ T[:3, :3], T[:3, 3] + error[:3, 3]
        return Pose.from_matrix(T)

    def _perceive(self, view: PosedView, rendered: Rendered, key: tuple[object, ...]) -> ViewPerception | None:
        """What a worker says of a view; None for one that looks straight down, which detectors can't read."""
        backend = self.backend if view.is_robot else self._camera_backend
        depth_m = measured_depth_m(view.depth_m, view.depth_source)
        shown = replace(rendered, rgb=view.rgb, depth_m=depth_m)
        seen = self._seen(backend, shown, view.camera, view.T_world_camera, key)
        return None if seen is None else _as_sent(seen.perception, view, seen.models)

    def _seen(
        self, backend: Backend, shown: Rendered, lens: Pinhole, T_world_camera: Matrix4, key: tuple[object, ...]
    ) -> Seen | None:
        """What ``backend`` sees in what it is shown."""
        if looks_straight_down(T_world_camera):
            return None
        told = TrueInstances(shown.instance_ids, self._labels, T_world_camera) if backend.needs_truth else None
        found = backend.perceive(shown.rgb, shown.depth_m, lens, prompts=self._words, truth=told, key=key)
        return Seen(found, backend.models)

    def _depth(
        self, T_world_camera: Matrix4, camera: Pinhole, range_m: tuple[float, float], noise: DepthNoise, *name: object
    ) -> Rendered:
        settings = self.building.settings
        return self.building.renderer.render(
            T_world_camera,
            self._lens(camera),
            depth_range_m=range_m,
            noise=noise if settings.depth_noise else None,
            seed=noise_seed(settings.seed, *name),
            colors=False,
        )

    def _lens(self, camera: Pinhole) -> Pinhole:
        """The same lens over fewer, larger pixels."""
        return camera.resized(camera.width_px // self._scale, camera.height_px // self._scale)

    def _indices(self, camera: PlannedCamera) -> tuple[int, ...]:
        return camera.half if self._half else tuple(range(len(camera.views)))

    def _info(self, camera: PlannedCamera) -> CameraInfo:
        return CameraInfo(
            stamp_ns=0,
            camera=camera.name,
            floor=camera.floor,
            position_m=camera.position_m,
            mounting_offset_m=self._plan.mounting_offset_m,
            intrinsics=self._plan.intrinsics,
            views=[CameraViewInfo(i, camera.views[i]) for i in self._indices(camera)],
        )
