"""What a real detector found of what each view truly shows: the measurements that the error model is fitted to."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.play.sight import SeenView
from surveilnav.geometry import Pinhole, Pose
from surveilnav.perception.boxes import overlaps
from surveilnav.perception.embedders import class_space
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.vocabulary import COCO, Vocabulary
from surveilnav.sensing.views import DetectedObject, TrueInstances, box_cells
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.truth.backends import Simulated
from surveilnav.simulator.truth.error_model import ErrorModel, Floats, sights
from surveilnav.simulator.truth.visible import Candidates, Place, VisibleThing, candidates, measured, world_points
from surveilnav.storage import read_parts, write_parts

MIN_SIZE_RAD = 0.02
_NO_PICTURE = np.zeros((0, 0, 3), np.uint8)
_FORMAT = b"surveilnav views 2"
_SCALE = 2  # views are kept at this fraction of their resolution: that at which ``simulated`` sees them


class MeasuredDetection(msgspec.Struct, frozen=True):
    """A detection: box in pixels of the kept view, the instance that most of its mask shows (0: none) and its share,
    the median depth under its mask [m], the share that its label has of all classes' scores, and the next class (where the
    embedding says so: of COCO's detectors)."""

    label: str
    score: float
    box_px: tuple[float, float, float, float]
    id: int
    share: float
    depth_m: float
    certainty: float = 1.0
    second: str = ""


class MeasuredView(msgspec.Struct, frozen=True):
    """A view with what truly shows and what was found. ``presence``: of each of COCO's classes, from the image's
    embedding; empty where that is of another space."""

    source: str
    view: int
    seq: int
    T_world_camera: Pose
    camera: Pinhole
    ids: bytes
    depth_mm: bytes
    found: list[MeasuredDetection]
    presence: list[float]

    @property
    def is_camera(self) -> bool:
        """Not a robot's."""
        return self.source.startswith("camera/")

    @property
    def key(self) -> tuple[object, ...]:
        """What tells it from other views of its building."""
        return self.source, self.view, self.seq

    def truth(self, labels: dict[int, str]) -> tuple[TrueInstances, NDArray[np.float32]]:
        """What each pixel shows, and depth [m]."""
        shape = self.camera.height_px, self.camera.width_px
        ids = np.frombuffer(zlib.decompress(self.ids), np.uint16).reshape(shape)
        depth = np.frombuffer(zlib.decompress(self.depth_mm), np.uint16).reshape(shape)
        told = TrueInstances(ids, labels, self.T_world_camera.matrix())
        return told, depth.astype(np.float32) / np.float32(1000)


class _Home(msgspec.Struct, frozen=True):
    name: str
    labels: dict[int, str]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredViews:
    """All views of one building."""

    name: str
    labels: dict[int, str]
    views: list[MeasuredView]


def measured_views_of(
    name: str, seen: Sequence[SeenView], building: SimulatedBuilding, vocabulary: Vocabulary = COCO
) -> MeasuredViews:
    """Adds to the views of a building what they truly show, in the words of the detector's ``vocabulary``."""
    views = [_measured(s, building) for s in seen if s.perception is not None]
    labels = building.scene.truth_labels
    own = {id_: said for id_, label in labels.items() if (said := vocabulary.exact_name(label))}
    return MeasuredViews(name, measured(labels) | own, views)


def _measured(seen: SeenView, building: SimulatedBuilding) -> MeasuredView:
    view, camera = seen.view, seen.view.camera
    small = camera.resized(camera.width_px // _SCALE, camera.height_px // _SCALE)
    shown = building.renderer.render(
        view.T_world_camera, small, depth_range_m=view.depth_range_m, noise=None, seed=0, colors=False
    )
    depth_m = np.nan_to_num(view.depth_m[_SCALE // 2 :: _SCALE, _SCALE // 2 :: _SCALE])
    assert seen.perception is not None
    image, is_of_classes = seen.perception.image_embedding, seen.perception.embedding_model == ClassSpace.model
    large = shown.instance_ids.repeat(_SCALE, axis=0).repeat(_SCALE, axis=1)
    found = [_found(d, view.depth_m, large, _SCALE, is_of_classes) for d in seen.perception.detections]
    return MeasuredView(
        view.source,
        view.view,
        view.seq,
        Pose.from_matrix(view.T_world_camera),
        small,
        zlib.compress(shown.instance_ids.tobytes(), 1),
        zlib.compress((depth_m * 1000).round().astype(np.uint16).tobytes(), 1),
        found,
        [round(float(p), 4) for p in class_space.presence(image)] if is_of_classes else [],
    )


def _found(
    d: DetectedObject, depth_m: NDArray[np.float32], ids: NDArray[np.uint16], scale: int = 1, is_of_classes: bool = True
) -> MeasuredDetection:
    x0, y0, x1, y1 = box_cells(d.box_px, depth_m.shape[1], depth_m.shape[0])
    under_ids = ids[y0:y1, x0:x1][d.mask if d.mask is not None else slice(None)].ravel()
    counts = np.bincount(under_ids) if under_ids.size else np.zeros(1, np.int64)
    id_ = int(counts.argmax())
    under = depth_m[y0:y1, x0:x1][d.mask if d.mask is not None else slice(None)]
    under = under[under > 0]
    box = tuple(float(v) / scale for v in d.box_px)
    return MeasuredDetection(
        d.label,
        d.score,
        box,  # type: ignore[arg-type]
        id_,
        float(counts[id_] / max(1, under_ids.size)),
        float(np.median(under)) if under.size else 0.0,
        *(_shares(d.embedding) if is_of_classes else (1.0, "")),
    )


def _shares(embedding: NDArray[np.float32]) -> tuple[float, str]:
    """The share of the best class of all classes' scores, and the next class."""
    shares = embedding[: len(COCO)] ** 2
    first, second = (int(i) for i in np.argsort(-shares, kind="stable")[:2])
    return round(float(shares[first] / shares.sum()), 3), COCO[second] if shares[second] > 0 else ""


def save(views: MeasuredViews, path: Path) -> None:
    """Writes the views of a building to a file, whole or not at all."""
    building = _Home(views.name, views.labels)
    write_parts(path, _FORMAT, [msgspec.msgpack.encode(part) for part in (building, *views.views)])


def load(path: Path) -> MeasuredViews | None:
    """What ``save`` wrote; None if there is no such file, or it is damaged."""
    parts = read_parts(path, _FORMAT)
    if parts is None:
        return None
    building = msgspec.msgpack.decode(parts[0], type=_Home)
    return MeasuredViews(
        building.name, building.labels, [msgspec.msgpack.decode(p, type=MeasuredView) for p in parts[1:]]
    )


def simulated(
    views: MeasuredViews, model: ErrorModel, seed: int = 0
) -> tuple[list[list[MeasuredDetection]], NDArray[np.float32]]:
    """What the backend ``simulated`` finds in the same views, and its presence of classes (views, 80)."""
    backend, found, presence = Simulated(seed=seed, model=model), [], []
    for look in views.views:
        truth, depth_m = look.truth(views.labels)
        seen = backend.perceive(_NO_PICTURE, depth_m, look.camera, truth=truth, key=look.key)
        found.append([_found(d, depth_m, truth.ids) for d in seen.detections])
        presence.append(class_space.presence(seen.image_embedding))
    return found, np.array(presence, np.float32)


# --- rows ---------------------------------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class OutcomeTable:
    """All candidates of one kind in many views, and what became of each.

    ``view``: (N,) number of the view; ``building``: (N,); ``name``: what it was called, "" if it wasn't found; ``box``:
    (N, 4) of the detection: corners relative to the visible box, or for places (width, height, 0, 0) at 1 m [rad].
    """

    kind: str
    labels: NDArray[np.str_]
    ids: NDArray[np.uint64]
    x: Floats
    direction: Floats
    range_m: Floats
    view: NDArray[np.int64]
    building: NDArray[np.int64]
    name: NDArray[np.str_]
    score: Floats
    certainty: Floats
    box: Floats

    @property
    def found(self) -> NDArray[np.bool_]:
        """(N,) whether it was called anything."""
        return np.asarray(self.name != "")

    @property
    def right(self) -> NDArray[np.bool_]:
        """(N,) whether it was called by its own name."""
        return np.asarray(self.name == self.labels)

    @property
    def classes(self) -> list[str]:
        """All labels except the empty one."""
        return sorted(set(self.labels.tolist()) - {""})

    @property
    def sight(self) -> NDArray[np.str_]:
        """(N,) one of ``SIGHTS`` each."""
        return np.array(sights(self.x), dtype=np.str_)

    def where(self, keep: NDArray) -> OutcomeTable:
        values = (getattr(self, name)[keep] for name in self.__dataclass_fields__ if name != "kind")
        return OutcomeTable(self.kind, *values)


def rows_of(
    buildings: Sequence[MeasuredViews], found: Sequence[Sequence[Sequence[MeasuredDetection]]] | None = None
) -> dict[str, OutcomeTable]:
    """The rows of buildings, by kind; ``found`` replaces what was found (of every view of every building)."""
    parts: dict[str, list[tuple]] = {}
    number = 0
    for h, building in enumerate(buildings):
        for i, look in enumerate(building.views):
            truth, depth_m = look.truth(building.labels)
            said = look.found if found is None else found[h][i]
            shown = candidates(truth, depth_m, look.camera, look.is_camera, MIN_SIZE_RAD)
            for c, outcomes in zip(shown, _assigned(shown, said, look), strict=True):
                n = len(c.ids)
                names, scores, certainties, boxes = zip(*outcomes, strict=True)
                parts.setdefault(c.kind, []).append(
                    (
                        c.labels,
                        c.ids,
                        c.x,
                        c.direction,
                        c.range_m,
                        np.full(n, number),
                        np.full(n, h),
                        names,
                        scores,
                        certainties,
                        boxes,
                    )
                )
            number += 1
    return {
        kind: OutcomeTable(kind, *(np.concatenate(column) for column in zip(*p, strict=True)))
        for kind, p in parts.items()
    }


_Outcome = tuple[str, float, float, tuple[float, ...]]
_MISSED: _Outcome = ("", 0.0, 1.0, (0.0, 0.0, 0.0, 0.0))


def _assigned(
    shown: Sequence[Candidates], found: Sequence[MeasuredDetection], look: MeasuredView
) -> Iterator[list[_Outcome]]:
    """For every kind, what each candidate was found as: its own name if anything says it, else the best score's.

    A detection goes to the thing whose box it fits (IoU 0.5, its own class first), else to that which most of its mask
    shows, else to the place where its middle lies.
    """
    things = [t for c in shown for t in c.shown if isinstance(t, VisibleThing)]
    at = [c.shown for c in shown if c.kind == "place"]
    owners = owners_of(things, found)
    outcomes: dict[int, _Outcome] = {}
    for d, owner in sorted(zip(found, owners, strict=True), key=lambda pair: pair[0].score):
        if owner is not None:
            x0, y0, x1, y1 = owner.box_px
            loose = (np.array(d.box_px) - np.array([x0, y0, x0, y0])) / np.array([x1 - x0, y1 - y0] * 2)
            known = outcomes.get(owner.number)
            if known is None or d.label == owner.label or known[0] != owner.label:
                outcomes[owner.number] = d.label, d.score, d.certainty, tuple(loose.tolist())
        elif at and d.depth_m > 0:
            x0, y0, x1, y1 = d.box_px
            px_per_m = look.camera.fx_px / d.depth_m
            size = ((x1 - x0) / px_per_m, (y1 - y0) / px_per_m, 0.0, 0.0)
            outcomes[_nearest(at[0], d, look).number] = d.label, d.score, d.certainty, size
    for c in shown:
        yield [outcomes.get(t.number, _MISSED) for t in c.shown]


def owners_of(things: Sequence[VisibleThing], found: Sequence[MeasuredDetection]) -> list[VisibleThing | None]:
    """The thing that each detection shows, or None."""
    if not things or not found:
        return [None] * len(found)
    iou, _ = overlaps(np.array([d.box_px for d in found], np.float32), np.array([t.box_px for t in things], np.float32))
    own = np.array([[d.label == t.label for t in things] for d in found])
    best = (np.where(iou >= 0.5, iou, 0.0) + own * (iou >= 0.5)).argmax(axis=1)
    by_id = {t.id: t for t in things}
    return [
        things[j] if iou[i, j] >= 0.5 else by_id.get(d.id) if d.share >= 0.5 else None
        for i, (d, j) in enumerate(zip(found, best, strict=True))
    ]


def _nearest(at: Sequence[VisibleThing | Place], d: MeasuredDetection, look: MeasuredView) -> Place:
    """The place nearest to the middle of a detection."""
    shown = [p for p in at if isinstance(p, Place)]
    x0, y0, x1, y1 = d.box_px
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, d.depth_m)
    u, v, z = np.array([middle, *((*p.center_px, p.range_m) for p in shown)]).T
    p_world = world_points(u, v, z, look.camera, look.T_world_camera.matrix())
    return shown[int(np.linalg.norm(p_world[1:] - p_world[0], axis=1).argmin())]
