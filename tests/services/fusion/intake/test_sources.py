"""Who is listened to, and which frames are let in: a node of a few lines instead of the bus."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import msgspec
import pytest
import structlog

from surveilnav import contract
from surveilnav.bus import Received, Unanswered, clock_ns
from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import CameraInfo, CameraViewInfo, FrameHeader, RobotDescription
from surveilnav.messages.view import PayloadPart
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.intake import observations
from surveilnav.services.fusion.intake import sources as module
from surveilnav.services.fusion.intake.camera_searches import CameraSearches
from surveilnav.services.fusion.intake.sources import Sources
from surveilnav.services.fusion.intake.wanted_pictures import WantedPictures
from surveilnav.services.fusion.shard import WHOLE_BUILDING, Shard
from tests.waiting import until

CAMERA = Pinhole.from_hfov(160, 120, 1.4)


class FakeTable:
    def __init__(self) -> None:
        self.said: dict[str, SimpleNamespace] = {}

    def rows(self, max_age_s=None):
        return list(self.said.values())


class FakeSlot:
    def __init__(self) -> None:
        self.frame, self.closed = None, False

    def poll(self):
        frame, self.frame = self.frame, None
        return frame

    def close(self) -> None:
        self.closed = True


class FakeNode:
    """What the sources need of a node."""

    def __init__(self) -> None:
        self.infos, self.statuses, self.living = FakeTable(), FakeTable(), set()
        self.slots: dict[tuple[object, ...], FakeSlot] = {}
        self.slots_opened: list[FakeSlot] = []
        self.rejected: list[str] = []
        self.warned: list[tuple[str, dict[str, object]]] = []
        self.problems: dict[str, str] = {}
        self.log = structlog.wrap_logger(None, processors=[self._drop])

    def _drop(self, *_):
        raise structlog.DropEvent

    def report_problem(self, name, text):
        self.problems[name] = text

    def table(self, stream):
        return self.infos if stream is contract.CAMERA_INFO else self.statuses

    def latest(self, stream, **ids):
        slot = self.slots[tuple(ids.values())] = FakeSlot()
        self.slots_opened.append(slot)
        return slot

    def alive(self, kind):
        return set(self.living)

    def key(self, stream, **ids):
        return ""

    def reject(self, where, why):
        self.rejected.append(where)

    def warn_seldom(self, event, **facts):
        self.warned.append((event, facts))

    def robots(self, *names: str) -> None:
        """Only they have said something lately."""
        self.statuses.said = {}
        for name in names:
            self.robot(name)

    def robot(self, name: str, floor: str = "0", seq: int = 0) -> None:
        """It has said that it is on a floor, and which observation is its newest."""
        message = SimpleNamespace(floor=floor, description=RobotDescription(), seq=seq)
        self.statuses.said[name] = SimpleNamespace(ids={"robot": name}, message=message, request_id="")

    def camera(self, name: str, views=(0,), z_m=1.8, floor="0") -> None:
        pose = Pose((0.0, 0.0, z_m), (0.0, 0.0, 0.0, 1.0))
        message = CameraInfo(
            stamp_ns=1,
            camera=name,
            floor=floor,
            position_m=(0.0, 0.0, z_m),
            mounting_offset_m=1.8,
            intrinsics=CAMERA,
            views=[CameraViewInfo(view, pose) for view in views],
        )
        self.infos.said[name] = SimpleNamespace(ids={"camera": name}, message=message)


def header(source="robot/r", **more) -> FrameHeader:
    fields = {"stamp_ns": 1, "view": 0, "seq": 1, "floor": "0"} | more
    return FrameHeader(
        source=source,
        T_world_camera=Pose((1.0, 2.0, 0.9), (0.0, 0.0, 0.0, 1.0)),
        camera=CAMERA,
        mounting_offset_m=0.9,
        depth_range_m=(0.1, 10.0),
        image=PayloadPart("jpeg", 1),
        depth=PayloadPart("depth-invq-zstd", 1),
        **fields,
    )


class Followed:
    """Sources that follow the robot r on floor 0."""

    def __init__(self, shard=WHOLE_BUILDING, **settings) -> None:
        self.node = FakeNode()
        self.node.robots("r")
        self.maps, self.words = BuildingMaps(FusionConfig()), SimpleNamespace(is_idle=True)
        self.searches = CameraSearches()
        self.wanted = WantedPictures(SimpleNamespace(targets=lambda: self.targets))
        self.targets: set[str] = set()
        self.ranking = SimpleNamespace(order=lambda info: [v.view for v in reversed(info.views)])
        self.sources = Sources(
            self.node,
            FusionSettings(**settings),
            self.maps,
            shard,
            self.words,
            self.searches,
            self.ranking,
            self.wanted,
        )
        self.look()
        self.says()
        self.look()

    def look(self):
        self.sources._refreshed_s = -1e9
        return self.sources.poll()

    def says(self, **fields) -> None:
        self.node.slots["r",].frame = Received("", {"robot": "r"}, header(**fields), b"", 1)


@pytest.fixture
def followed():
    return Followed()


@pytest.mark.parametrize("how", ["deleted", "renamed"])
def test_a_camera_that_says_nothing_of_itself_any_more_lingers(followed, how):
    followed.node.camera("c")
    followed.look()
    camera = followed.sources.cameras["c"]
    if how == "deleted":
        followed.node.infos.said.clear()
    else:
        followed.node.infos.said["c"].ids = {"camera": "other"}
    assert followed.look()[1] == []
    assert followed.sources.cameras == {"c": camera}


def test_a_lingering_camera_unheard_of_is_not_listened_to(followed, monkeypatch):
    monkeypatch.setattr(module, "_MAX_CAMERAS", 0)
    followed.node.camera("c")
    followed.look()
    monkeypatch.setattr(module, "_MAX_CAMERAS", 5)
    followed.node.infos.said.clear()
    followed.look()
    assert followed.sources.cameras == {}


@pytest.mark.parametrize(
    "fields", [{"seq": 2**53}, {"seq": 2**64 - 1}, {"seq": -1}, {"stamp_ns": 2**62}, {"stamp_ns": -1}]
)
def test_a_number_that_nobody_can_hold_is_counted_by_name_and_let_in_nowhere(followed, fields):
    followed.says(**{"seq": 2} | fields)
    assert followed.look()[0] == []
    assert followed.node.rejected == ["frame.bad_number"]
    followed.says(seq=2**53 - 1, stamp_ns=2**62 - 1)
    assert len(followed.look()[0]) == 1


def test_a_time_in_the_future_is_not_believed_and_its_clock_is_named(followed):
    hour_ns = 3600 * 10**9
    followed.says(seq=2, stamp_ns=clock_ns() + hour_ns)
    ((frame,), _) = followed.look()
    assert abs(frame.message.stamp_ns - clock_ns()) < 5e9
    assert followed.node.warned == [
        ("a clock is ahead, its times aren't believed", {"source": "robot/r", "ahead_s": 3600.0})
    ]
    followed.says(seq=3, stamp_ns=(right := clock_ns()))
    ((frame,), _) = followed.look()
    assert frame.message.stamp_ns == right


@pytest.mark.parametrize("view", [2**63, 64, -1])
def test_a_camera_with_a_view_that_nobody_can_number_is_not_listened_to(followed, view):
    followed.node.camera("c", [0, view])
    followed.look()
    assert followed.sources.cameras == {}
    assert followed.node.rejected == ["camera_info"]


def test_a_view_named_twice_is_listened_to_once(followed):
    slots = len(followed.node.slots_opened)
    followed.node.camera("c", [1, 0, 1, 1])
    followed.look()
    assert sorted(followed.sources.cameras["c"].slots) == [0, 1]
    assert len(followed.node.slots_opened) == slots + 2


def test_a_robot_that_is_silent_and_gone_makes_room(followed, monkeypatch):
    monkeypatch.setattr(module, "_MAX_ROBOTS", 1)
    node, slot = followed.node, followed.node.slots["r",]
    node.living = {"r"}
    node.robots("s")
    followed.look()
    assert ("s",) not in node.slots  # r is silent, and yet there
    node.living = {"s"}
    node.robots("r", "s")
    followed.look()
    assert ("s",) not in node.slots  # r is not silent
    node.robots("s")
    followed.look()
    assert ("s",) in node.slots
    assert slot.closed


@pytest.mark.parametrize(
    ("ahead", "heard"), [(0, [["near"]] * 3), (2, [["near", "up1", "up2"], ["near", "up2", "up3"], ["near"]])]
)
def test_while_nobody_searches_a_few_other_cameras_are_looked_through_once(ahead, heard):
    f = Followed(prefetch_cameras=ahead)
    f.node.camera("near")
    for name in ("up1", "up2", "up3"):
        f.node.camera(name, views=(0, 1), z_m=4.8)
    told = []
    for held in ({}, {"up1": {0, 1}, "up2": {0}}, {"up1": {0, 1}, "up2": {0, 1}, "up3": {0, 1}}):
        f.maps.processed.views = held
        f.look()
        told.append(sorted(f.sources.cameras))
    assert told == heard


def test_a_search_ends_looking_ahead_and_silent_cameras_are_passed_over():
    f = Followed(prefetch_cameras=1)
    for name in ("up1", "up2"):
        f.node.camera(name, z_m=4.8)
    f.look()
    assert list(f.sources.cameras) == ["up1"]
    f.sources.cameras["up1"].is_silent = True
    for _ in range(2):
        f.look()
        assert list(f.sources.cameras) == ["up2"]
    f.words.is_idle = False
    f.look()
    assert not f.sources.cameras


def test_a_search_with_cameras_invokes_those_of_its_floor_without_a_robot(followed):
    followed.sources._floor_z_m.clear()  # no robot has been seen
    followed.node.robots()
    followed.node.camera("c")
    followed.look()
    assert not followed.sources.cameras
    with followed.searches.open("tv", "1"):
        followed.look()
        assert not followed.sources.cameras
    with followed.searches.open("tv", "0"):
        followed.look()
        assert set(followed.sources.cameras) == {"c"}


def test_a_shard_takes_the_robots_and_cameras_of_its_floors_only():
    followed = Followed(Shard("low", frozenset({"0"})))
    followed.node.camera("here")
    followed.node.camera("above", floor="1")
    assert [info.camera for info in followed.sources.infos()] == ["here"]
    followed.look()
    assert set(followed.sources.cameras) == {"here"}
    followed.node.robots("r", "other")
    followed.node.robot("other", floor="1")
    followed.look()
    assert ("r",) in followed.node.slots
    assert ("other",) not in followed.node.slots, "another shard follows it"


def test_a_robot_that_takes_the_stairs_changes_shards():
    followed = Followed(Shard("low", frozenset({"0"})))
    slot = followed.node.slots["r",]
    followed.says(seq=2, floor="1", stamp_ns=2)
    frames, _ = followed.look()
    assert not frames, "what it sees on another floor is for the other shard, even before it says where it is"
    followed.node.robot("r", floor="1")
    followed.look()
    assert slot.closed
    followed.node.robot("r", floor="0")
    followed.look()
    followed.says(seq=9, stamp_ns=9)
    frames, _ = followed.look()
    assert [frame.message.seq for frame in frames] == [9]


class Asked:
    """Has a robot's observation asked for, on a clock of the test's own."""

    def __init__(self, followed, monkeypatch) -> None:
        self.followed, self.now_s, self.asked_s = followed, 100.0, []
        self.answer = None
        monkeypatch.setattr(observations, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        followed.node.ask, followed.node.wake = self._ask, threading.Event()

    def _ask(self, stream, *, parameters, timeout_s, **ids):
        assert (stream, ids) == (contract.ROBOT_OBSERVATION, {"robot": "r"})
        self.asked_s.append(self.now_s)
        self.asked_seq = int(parameters["seq"])
        if self.answer is None:
            raise Unanswered("nobody")
        return self.answer

    def look(self, seconds: float = 0.0) -> list[int]:
        """The sequence numbers of what comes, over some time."""
        came = []
        for _ in range(1 + round(seconds * 4)):  # every quarter of a second
            before = len(threading.enumerate())
            came += [frame.message.seq for frame in self.followed.look()[0]]
            until(lambda before=before: len(threading.enumerate()) <= before)
            self.now_s += 0.25
        return came


@pytest.fixture
def asked(followed, monkeypatch):
    followed.node.robot("r", seq=1)
    return Asked(followed, monkeypatch)


def test_nobody_asks_for_what_came(asked):
    assert asked.look(60.0) == []
    assert asked.asked_s == []


def test_an_observation_that_got_lost_is_asked_for_ever_more_seldom_until_it_comes(asked):
    asked.followed.node.robot("r", seq=2)
    asked.look(35.0)
    assert [round(at_s - 100.0) for at_s in asked.asked_s] == [2, 4, 10, 22]
    asked.answer = Received("", {"robot": "r"}, header(seq=2), b"", 1)
    assert asked.look(35.0) == [2]
    n = len(asked.asked_s)
    asked.look(60.0)
    assert len(asked.asked_s) == n


@pytest.mark.parametrize("seq", [1, 3])
def test_an_answer_with_another_number_changes_nothing(asked, seq):
    asked.followed.node.robot("r", seq=2)
    asked.answer = Received("", {"robot": "r"}, header(seq=seq, stamp_ns=seq), b"", 1)
    assert asked.look(35.0) == []
    assert asked.asked_seq == 2
    assert [round(at_s - 100.0) for at_s in asked.asked_s] == [2, 4, 10, 22]


def test_a_late_answer_doesnt_come_after_a_newer_observation(asked):
    asked.followed.node.robot("r", seq=2)
    asked.look(1.25)
    asked.answer = Received("", {"robot": "r"}, header(seq=2, stamp_ns=2), b"", 1)
    asked.now_s += 1.0
    asked.followed.sources._follow_robots()  # asks
    until(lambda: not asked.followed.sources._robots._answers.empty())
    asked.followed.says(seq=3, stamp_ns=3)
    asked.followed.node.robot("r", seq=4)
    assert asked.look(1.0) == [3]


def test_a_robot_that_came_back_is_asked_though_its_number_is_the_same(asked):
    asked.followed.node.living = {"r"}
    asked.answer = Received("", {"robot": "r"}, header(seq=1, stamp_ns=99), b"", 1)
    assert asked.look(3.0) == [1]
    assert len(asked.asked_s) == 1
    assert asked.look(40.0) == []
    assert len(asked.asked_s) == 1


def test_an_answer_that_came_too_late_isnt_let_in(asked):
    asked.followed.node.robot("r", seq=2)
    asked.answer = Received("", {"robot": "r"}, header(seq=2), b"", 1)
    asked.look(0.75)
    asked.now_s += 1.0
    asked.followed.sources._follow_robots()  # asks
    until(lambda: not asked.followed.sources._robots._answers.empty())
    asked.followed.says(seq=3, stamp_ns=3)
    assert asked.look() == [3]


@pytest.mark.parametrize(
    ("budget_bytes_s", "n_views", "orders"), [(20_000.0, 3, [[2, 1, 0]]), (0.0, 3, []), (20_000.0, 1, [])]
)
def test_cameras_with_a_budget_are_told_which_views_are_wanted_first(followed, budget_bytes_s, n_views, orders):
    asked = []
    followed.node.ask = lambda stream, request, **ids: asked.append(request)
    followed.node.camera("c", views=range(n_views))
    row = followed.node.infos.said["c"]
    row.message = msgspec.structs.replace(row.message, budget_bytes_s=budget_bytes_s)
    followed.look()
    followed.look()
    until(lambda: not any(t.name.startswith("order-") for t in threading.enumerate()))
    assert [r.views for r in asked if r.action == "order"] == orders


def test_pictures_are_asked_for_of_views_that_werent_looked_at_for_what_is_searched(followed):
    asked = []
    followed.node.ask = lambda stream, request, **ids: asked.append(request)
    followed.node.camera("c", views=(0, 1, 2))
    followed.look()
    for view, words in ((0, ["tv"]), (1, ["tv", "ladder"])):
        followed.wanted.looked(("camera/c", view), words)
    followed.look()
    assert asked == [], "nothing is searched"
    followed.targets = {"ladder"}
    followed.look()
    followed.look()
    until(lambda: asked)
    assert [(r.views, r.pictures) for r in asked] == [([0], True)]
    assert followed.wanted.of("c") == [0]
    followed.wanted.came(("camera/c", 0))
    assert followed.wanted.of("c") == []
    followed.wanted.looked(("camera/c", 0), ["tv"])
    followed.wanted.forget("camera/c")
    assert followed.wanted.of("c") == []


def test_a_camera_that_doesnt_answer_for_pictures_isnt_silent(followed):
    """It has sent all its views: only pictures of them aren't waited for."""

    def fails(stream, request, **ids):
        raise Unanswered("nobody")

    followed.node.ask = fails
    followed.node.camera("c")
    followed.look()
    followed.wanted.looked(("camera/c", 0), ["tv"])
    followed.targets = {"ladder"}
    followed.look()
    camera = followed.sources.cameras["c"]
    until(lambda: camera.gives_no_pictures)
    assert not camera.is_silent
