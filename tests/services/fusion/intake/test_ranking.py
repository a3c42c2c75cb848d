"""Which of the waiting views perception is asked about next."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import CameraInfo, CameraViewInfo, FrameHeader, PayloadPart
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.intake import ranking as module
from surveilnav.services.fusion.intake.ranking import ViewRanking
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from tests.services.fusion.core.views.test_order import pose

LENS = Pinhole.from_hfov(64, 64, 1.5)


def header(source: str, view: int, x_m: float, mounting_offset_m: float = 1.8) -> FrameHeader:
    T = pose(0.0, 90.0)
    T[0, 3] = x_m
    part = PayloadPart("jpeg", 0)
    return FrameHeader(
        stamp_ns=1,
        source=source,
        view=view,
        seq=1,
        floor="0",
        T_world_camera=Pose.from_matrix(T),
        camera=LENS,
        mounting_offset_m=mounting_offset_m,
        depth_range_m=(0.1, 10.0),
        image=part,
        depth=part,
    )


@pytest.fixture
def positions():
    positions = RobotPositions()
    positions.record(header("robot/r1", 0, 5.1))
    return positions


@pytest.fixture
def ranking(positions):
    maps = SimpleNamespace(lock=threading.Lock(), joint=JointMap(FusionConfig()))
    return ViewRanking(maps, positions)


WAITING = {("camera/c", view): header("camera/c", view, float(view)) for view in range(8)}


def test_the_view_nearest_to_the_robot_comes_first(ranking):
    waiting, order = dict(WAITING), []
    while waiting:
        order.append(ranking.pop_best(waiting))
        del waiting[order[-1]]
    assert [view for _, view in order] == [5, 6, 4, 7, 3, 2, 1, 0]


def test_a_cameras_views_are_ordered_as_its_frames_would_be(ranking):
    """All views of a camera are at one place: it is by where they look that they differ."""
    poses = [Pose.from_matrix(pose(yaw, 30.0)) for yaw in (180.0, 0.0, 90.0)]
    info = CameraInfo(
        stamp_ns=1,
        camera="c",
        floor="0",
        position_m=poses[0].translation_m,
        mounting_offset_m=poses[0].translation_m[2],
        intrinsics=LENS,
        views=[CameraViewInfo(7 + n, at) for n, at in enumerate(poses)],
    )
    order = ranking.order(info)
    assert sorted(order) == [7, 8, 9]
    assert order[0] == 8, "the robot is in that direction"


def test_of_views_worth_the_same_the_first_comes_first(ranking):
    waiting = {("camera/c", view): header("camera/c", view, 2.0) for view in (3, 1, 2)}
    assert ranking.pop_best(waiting) == ("camera/c", 3)


def test_a_ranking_ages_and_forgets_who_is_gone(ranking, positions, monkeypatch):
    now_s = 100.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s)
    assert ranking.pop_best(WAITING) == ("camera/c", 5)
    positions.record(header("robot/r1", 0, 0.0))
    few = {key: WAITING[key] for key in [("camera/c", 7), ("camera/c", 0)]}
    assert ranking.pop_best(few) == ("camera/c", 7), "by the ranking of before"
    now_s += 0.6
    few = {key: WAITING[key] for key in [("camera/c", 1), ("camera/c", 0)]}
    assert ranking.pop_best(few) == ("camera/c", 0), "the robot is elsewhere now"
