"""The maps of a floor in one answer: of one moment, whatever is integrated meanwhile, and only what has changed."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from surveilnav.bus import Received, Refused, Request
from surveilnav.errors import WireError
from surveilnav.geometry import Pose
from surveilnav.messages import FrameHeader, PayloadPart, Revision
from surveilnav.sensing.layers import GRID_LAYERS
from surveilnav.sensing.views import DetectedObject
from surveilnav.services.fusion.answers.floor_maps import FloorMapsAnswers
from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.core.snapshot import pack, unpack
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from surveilnav.services.fusion.intake.texts import TextEmbedding
from surveilnav.services.fusion.perceived import PerceivedView
from surveilnav.services.planner.floor_maps import FloorMapsClient


class Fusion:
    """Fusion's maps and their answers, without a bus: ``ask`` is what a planner's node would have."""

    def __init__(self, tools) -> None:
        self.tools = tools
        self.world = tools.world(
            boxes={"sofa": ((3.0, 1.0, 0.0), (4.6, 1.9, 0.8)), "box": ((4.8, 3.0, 0.0), (5.3, 3.5, 0.6))}
        )
        self.maps = BuildingMaps(FusionConfig())
        texts = SimpleNamespace(encode=lambda prompt: TextEmbedding(tools.unit(1), ""))
        positions = RobotPositions()
        revisions = SimpleNamespace(pending_views=lambda floor: 0)
        self.answers = FloorMapsAnswers(MapReader(self.maps, texts, positions), revisions)
        self.truth: dict[int, tuple] = {}  # revision -> layers and objects, as they were then
        self.seq, self.sent = 0, []

    def integrate(self) -> None:
        """The robot's next view."""
        self.seq += 1
        view = self.world.view(1.0 + 0.15 * (self.seq % 14), 2, 0.2 * self.seq, -0.2, seq=self.seq)
        found = [
            self.world.detect(view, name, label, 0.6, self.tools.unit(k))
            for k, (name, label) in enumerate((("sofa", "couch"), ("box", "chair")))
        ]
        seen = self.tools.seen(
            *[d for d in found if isinstance(d, DetectedObject)], image=self.tools.unit(self.seq % 4)
        )
        header = FrameHeader(
            stamp_ns=view.stamp_ns,
            source=view.source,
            view=0,
            seq=self.seq,
            floor="0",
            camera=view.camera,
            depth_range_m=view.depth_range_m,
            T_world_camera=Pose.from_matrix(view.T_world_camera),
            mounting_offset_m=view.mounting_offset_m,
            image=PayloadPart("jpeg", 0),
            depth=PayloadPart("depth-invq-zstd", 0),
        )
        self.maps.integrate(PerceivedView((view.source, 0), header, view, seen))
        joint = self.maps.joint
        layers = {n: joint.layer("0", n, *((self.tools.unit(1), "") if n == "value" else ()))[1] for n in GRID_LAYERS}
        self.truth[joint.revision] = {n: layer.copy() for n, layer in layers.items()}, joint.objects("0"), self.seq

    def revision(self) -> Revision:
        return Revision(
            stamp_ns=1,
            floor="0",
            revision=self.maps.joint.revision,
            floor_z_m=0.0,
            robots={"r": self.seq},
            cameras=[],
            pending_views=0,
        )

    def ask(self, stream, *, floor, timeout_s, parameters):
        answer = self.answers.floor_maps(Request({"floor": floor}, parameters, None, b"", 0))
        self.sent.append(answer)
        return Received(message=answer.message, payload=answer.payload, ids={"floor": floor}, received_ns=0, key="")


class BusyLock:
    """A lock that has the maps integrate a view whenever somebody lets go of it: between any two reads."""

    def __init__(self, fusion: Fusion) -> None:
        self._fusion, self._lock, self.busy = fusion, threading.Lock(), True

    def __enter__(self):
        return self._lock.__enter__()

    def __exit__(self, *error):
        self._lock.__exit__(*error)
        if self.busy:
            self.busy = False
            self._fusion.integrate()
            self.busy = True


@pytest.fixture
def fusion(tools):
    fusion = Fusion(tools)
    for _ in range(3):
        fusion.integrate()
    return fusion


def same_moment(fusion, maps) -> bool:
    """Whether maps are, to the bit, those that fusion had at their revision."""
    layers, objects, _ = fusion.truth[maps.revision]
    equal = [np.array_equal(getattr(maps, name), layers[name], equal_nan=name == "value") for name in GRID_LAYERS]
    return all(equal) and list(maps.objects) == objects


def test_whatever_is_integrated_between_two_reads_an_answer_is_of_one_revision(fusion):
    """The maps grow at every release of the lock; each answer, made of differences, is the maps of its own revision."""
    client = FloorMapsClient(fusion, "chair", 1.0)
    fusion.maps.lock = BusyLock(fusion)
    revisions = []
    for _ in range(12):
        decided_on = fusion.revision()
        with pytest.raises(WireError, match="expected maps with observation"):  # the maps went past it meanwhile
            client.maps_at(decided_on, "r")
        layers, objects, _ = fusion.truth[client._revision]
        assert [client._objects[id_] for id_ in sorted(client._objects)] == objects
        assert all(np.array_equal(client._layers[n], layers[n], equal_nan=n == "value") for n in GRID_LAYERS)
        revisions.append(client._revision)
    assert revisions == sorted(set(revisions)), "every answer was of a later revision"


def test_an_answer_holds_what_has_changed_and_nothing_else(fusion):
    client = FloorMapsClient(fusion, "chair", 1.0)
    first = client.maps_at(fusion.revision(), "r")
    again = client.maps_at(fusion.revision(), "r")
    whole, nothing = fusion.sent
    assert [part.layer for part in whole.message.layers] == list(GRID_LAYERS)
    assert len(whole.message.objects) == len(first.objects) > 0
    assert (nothing.message.layers, nothing.message.objects, nothing.payload) == ([], [], b"")
    assert same_moment(fusion, again)
    with fusion.maps.lock:  # something happens to one object alone
        objects = fusion.maps.joint._floors["0"].objects
        changed = next(iter(objects._objects.values()))
        changed.record, changed.revision = None, fusion.maps.joint.revision + 1
        fusion.maps.joint.revision += 1
        fusion.maps.joint._floors["0"].geometry.revision += 1
    client.maps_at(fusion.revision(), "r")
    assert [o.id for o in fusion.sent[-1].message.objects] == [changed.id]
    assert fusion.sent[-1].message.layers == []


def test_every_later_answer_is_smaller_than_the_whole(fusion):
    client = FloorMapsClient(fusion, "chair", 1.0)
    for _ in range(10):
        assert same_moment(fusion, client.maps_at(fusion.revision(), "r"))
        fusion.integrate()
    whole = FloorMapsClient(fusion, "chair", 1.0)
    assert same_moment(fusion, whole.maps_at(fusion.revision(), "r"))
    assert same_moment(fusion, client.maps_at(fusion.revision(), "r"))


def test_a_restart_of_fusion_starts_a_new_epoch(fusion):
    client = FloorMapsClient(fusion, "chair", 1.0)
    client.maps_at(fusion.revision(), "r")
    fusion.maps.restore(unpack(pack(fusion.maps.freeze())))
    assert same_moment(fusion, client.maps_at(fusion.revision(), "r"))
    assert fusion.sent[-1].message.since == -1
    assert len(fusion.sent[-1].message.layers) == len(GRID_LAYERS)


def test_a_late_answer_of_an_older_revision_does_not_hide_a_change(fusion):
    """Two planners ask at once; the one that read first is answered last."""
    early = {n: fusion.maps.joint.layer("0", n, fusion.tools.unit(1), "") for n in ("explored", "value")}
    r_early = fusion.maps.joint.revision
    fusion.integrate()
    late = {n: fusion.maps.joint.layer("0", n, fusion.tools.unit(1), "") for n in ("explored", "value")}
    r_late = fusion.maps.joint.revision
    key = ("e", "0", "chair")
    fusion.answers._changed(key, early, r_early, -1)
    fusion.answers._changed(key, late, r_late, -1)
    fusion.answers._changed(key, early, r_early, -1)  # the slow thread
    parts, _ = fusion.answers._changed(key, early, r_late + 1, r_late)  # as it was early, and not as the asker has it
    assert [part.layer for part in parts] == ["explored", "value"]


@pytest.mark.parametrize(("floor", "target", "name"), [("7", "chair", "unknown_floor"), ("0", "", "bad_target")])
def test_what_is_not_there_is_refused_by_name(fusion, floor, target, name):
    with pytest.raises(Refused) as refused:
        fusion.ask(None, floor=floor, timeout_s=1.0, parameters={"target": target})
    assert refused.value.name == name


def test_an_answer_that_lacks_something_is_no_map_and_the_next_is_asked_for_whole(fusion):
    client = FloorMapsClient(fusion, "chair", 1.0)
    client.maps_at(fusion.revision(), "r")
    client._objects.popitem()
    with pytest.raises(WireError, match="lack"):
        client.maps_at(fusion.revision(), "r")
    assert same_moment(fusion, client.maps_at(fusion.revision(), "r"))
    assert fusion.sent[-1].message.since == -1
