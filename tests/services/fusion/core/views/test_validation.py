"""Bad input: refused by name, the maps as they were."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import DetectedObject
from surveilnav.services.fusion.core import FusionConfig, JointMap, MapConfig
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.snapshot import pack
from surveilnav.services.fusion.core.views.validation import ViewError


def maps_of(joint: JointMap) -> bytes:
    """All that the maps hold, without what the guard remembers of sources."""
    return pack({k: v for k, v in joint.state().items() if k != "validator"})


@pytest.fixture
def seen_some(world, tools):
    """Maps that hold three views of a robot (the last at x = 2.4 m, seq 3, stamp 3 s) and one of a camera."""
    joint = JointMap(FusionConfig(map=MapConfig(max_floors=2, max_extent_m=40)))
    for i in (1, 2, 3):
        view = replace(world.view(1.8 + 0.2 * i, 2, 0.1 * i, seq=i), stamp_ns=i * 10**9)
        joint.accept(view, tools.seen(DetectedObject("chair", 0.8, (60.0, 60.0, 100.0, 110.0), None, tools.unit(0))))
    joint.accept(world.view(5, 3, -2.4, -0.5, height=1.8, source="camera/c"), tools.seen())
    joint.accept(replace(world.view(2, 2, 0, seq=1, source="robot/s", floor="1", floor_z=2.8), stamp_ns=1), None)
    return joint


def spoil_pose(view, change):
    T = view.T_world_camera.copy()
    change(T)
    return replace(view, T_world_camera=T)


def set_at(T, at, value):
    T[at] = value


def scaled(T):
    T[:3, :3] *= 1.1


def far_off(view):
    return spoil_pose(replace(view, seq=50), lambda T: set_at(T, (0, 3), 90.0))


def camera_with(view, **changes):
    c = view.camera
    fields = {"width_px": 160, "height_px": 120, "fx_px": c.fx_px, "fy_px": c.fy_px, "cx_px": c.cx_px, "cy_px": c.cy_px}
    return replace(view, camera=Pinhole(**(fields | changes)))


def depth_with(view, value, everywhere=False):
    depth_m = view.depth_m.copy()
    depth_m[slice(None) if everywhere else (5, 7)] = value
    return replace(view, depth_m=depth_m)


def one(tools, box=(0.0, 0.0, 5.0, 5.0), score=0.5, mask=None, embedding=None):
    return tools.seen(DetectedObject("c", score, box, mask, tools.unit(0) if embedding is None else embedding))


BAD8 = np.full(8, np.nan, np.float32)
#: what -> (name of the refusal, how the next good view is spoiled)
FAULTS = {
    "an infinite position": ("bad_pose", lambda v, t: (spoil_pose(v, lambda T: set_at(T, (0, 3), np.inf)), None)),
    "a NaN in the rotation": ("bad_pose", lambda v, t: (spoil_pose(v, lambda T: set_at(T, (1, 1), np.nan)), None)),
    "a rotation that scales": ("bad_pose", lambda v, t: (spoil_pose(v, scaled), None)),
    "a mirror": ("bad_pose", lambda v, t: (spoil_pose(v, lambda T: set_at(T, np.s_[:3, 0], -T[:3, 0])), None)),
    "a sheared last row": ("bad_pose", lambda v, t: (spoil_pose(v, lambda T: set_at(T, (3, 0), 0.5)), None)),
    "a mounting offset of NaN": ("bad_pose", lambda v, t: (replace(v, mounting_offset_m=math.nan), None)),
    "depth of another size": ("wrong_size", lambda v, t: (replace(v, depth_m=v.depth_m[:-1]), None)),
    "colour of another size": ("wrong_size", lambda v, t: (replace(v, rgb=v.rgb[:, :-1]), None)),
    "colour of another type": ("wrong_size", lambda v, t: (replace(v, rgb=v.rgb.astype(float)), None)),
    "intrinsics of another size": ("wrong_size", lambda v, t: (camera_with(v, width_px=320), None)),
    "a fish's eye": ("bad_intrinsics", lambda v, t: (camera_with(v, fx_px=1.0), None)),
    "a telescope": ("bad_intrinsics", lambda v, t: (camera_with(v, fy_px=1e6), None)),
    "a principal point outside": ("bad_intrinsics", lambda v, t: (camera_with(v, cx_px=-3.0), None)),
    "another focal length than before": ("intrinsics_changed", lambda v, t: (camera_with(v, fx_px=120.0), None)),
    "a negative depth": ("bad_depth", lambda v, t: (depth_with(v, -1.0), None)),
    "an infinite depth": ("bad_depth", lambda v, t: (depth_with(v, np.inf), None)),
    "no depth but NaN": ("no_depth", lambda v, t: (depth_with(v, np.nan, everywhere=True), None)),
    "no depth but 0": ("no_depth", lambda v, t: (depth_with(v, 0.0, everywhere=True), None)),
    "a box of NaN": ("bad_detection", lambda v, t: (v, one(t, box=(np.nan, 0, 5, 5)))),
    "a score of NaN": ("bad_detection", lambda v, t: (v, one(t, score=np.nan))),
    "a score of 2": ("bad_detection", lambda v, t: (v, one(t, score=2.0))),
    "a mask of another size": ("bad_mask", lambda v, t: (v, one(t, mask=np.ones((3, 3), np.bool_)))),
    "an embedding of NaN": ("bad_embedding", lambda v, t: (v, one(t, embedding=BAD8))),
    "a picture's embedding of NaN": ("bad_embedding", lambda v, t: (v, t.seen(image=BAD8))),
    "a shorter embedding of a detection": (
        "bad_embedding",
        lambda v, t: (v, one(t, embedding=np.ones(4, np.float32) / 2)),
    ),
    "4 m in one step": ("pose_jump", lambda v, t: (spoil_pose(v, lambda T: set_at(T, (0, 3), T[0, 3] + 4)), None)),
    "a stamp before the last": ("time_backwards", lambda v, t: (replace(v, stamp_ns=2 * 10**9), None)),
    "an old view, late": ("time_backwards", lambda v, t: (replace(v, seq=2, stamp_ns=2 * 10**9), None)),
    "a place beyond the map": ("out_of_map", lambda v, t: (far_off(v), None)),
    "a third floor of two": (
        "too_many_floors",
        lambda v, t: (spoil_pose(v, lambda T: set_at(T, (2, 3), T[2, 3] + 9)), None),
    ),
}


@pytest.mark.parametrize("what", FAULTS)
def test_every_fault_has_its_name_and_changes_nothing(seen_some, world, tools, what):
    name, spoil = FAULTS[what]
    good = replace(world.view(2.6, 2, 0.4, seq=4), stamp_ns=4 * 10**9)
    before, guarded = maps_of(seen_some), len(pack(seen_some.validator.state()))
    for _ in range(2):  # a repeated fault is no better
        with pytest.raises(ViewError) as refused:
            seen_some.accept(*spoil(good, tools))
        assert (refused.value.name, str(refused.value).split(":")[0]) == (name, name)
        assert maps_of(seen_some) == before
    assert len(pack(seen_some.validator.state())) < guarded + 400
    done = seen_some.accept(good, tools.seen())  # and hurts nobody after it
    assert done is not None
    assert done.revision == 6


def test_every_name_is_tested():
    from typing import get_args

    from surveilnav.services.fusion.core.views.validation import ViewFault

    elsewhere = {"geometry_disagrees", "quarantined", "frame_disagrees"}  # test_plausibility.py, test_robot_frames.py
    assert {name for name, _ in FAULTS.values()} | elsewhere == set(get_args(ViewFault))


def test_single_pixels_without_depth_are_left_out(seen_some, world):
    view = replace(world.view(2.6, 2, 0.4, seq=4), stamp_ns=4 * 10**9)
    holes = view.depth_m.copy()
    holes[::3, ::2], holes[1::3, ::5] = np.nan, 0.0
    assert seen_some.accept(replace(view, depth_m=holes), None).n_points > 1000


def test_a_repeated_observation_is_no_fault_and_counts_once(seen_some, world, tools):
    last = replace(world.view(1.8 + 0.2 * 3, 2, 0.1 * 3, seq=3), stamp_ns=3 * 10**9)
    before = maps_of(seen_some)
    for again in (last, replace(last, stamp_ns=9 * 10**9)):  # as it was, or stamped anew
        assert seen_some.accept(again, tools.seen()) is None
    assert maps_of(seen_some) == before


def test_a_cameras_new_picture_has_a_new_stamp(seen_some, world, tools):
    view = world.view(5, 3, -2.4, -0.5, height=1.8, source="camera/c")
    assert seen_some.accept(view, tools.seen()) is None
    assert seen_some.accept(replace(view, stamp_ns=5), tools.seen()) is not None
    assert seen_some.accept(replace(view, view=1), tools.seen()) is not None  # another view, another story


def test_missing_numbers_are_counted_and_accepted(seen_some, world):
    view = world.view(2.6, 2, 0.4, seq=7)
    assert seen_some.accept(replace(view, stamp_ns=7 * 10**9), None) is not None
    assert seen_some.validator.missed == {"robot/r": 3}
    far = spoil_pose(world.view(2.6, 2, 0.4, seq=10), lambda T: set_at(T, (0, 3), 2.6 + 5))  # 5 m in three steps
    assert seen_some.accept(replace(far, stamp_ns=10**10), None) is not None
    with pytest.raises(ViewError):  # refused, yet it came
        seen_some.accept(depth_with(replace(far, seq=11, stamp_ns=11 * 10**9), 0.0, everywhere=True), None)
    assert seen_some.accept(replace(far, seq=12, stamp_ns=12 * 10**9), None) is not None
    assert seen_some.validator.missed == {"robot/r": 5}


@pytest.mark.parametrize("what", ["4 m in one step", "a stamp before the last", "another focal length than before"])
def test_a_fault_that_the_next_view_stands_by_is_believed(seen_some, world, tools, what):
    _, spoil = FAULTS[what]
    good = replace(world.view(2.6, 2, 0.4, seq=4), stamp_ns=4 * 10**9)
    spoiled, _ = spoil(good, tools)
    with pytest.raises(ViewError):
        seen_some.accept(spoiled, None)
    with pytest.raises(ViewError):  # said again it is no more credible
        seen_some.accept(replace(spoiled, stamp_ns=spoiled.stamp_ns + 1), None)
    after = replace(spoiled, seq=5, stamp_ns=spoiled.stamp_ns + 10**8)
    assert seen_some.accept(after, tools.seen()) is not None
    assert seen_some.accept(replace(after, seq=6, stamp_ns=after.stamp_ns + 1), tools.seen()) is not None


def test_two_different_jumps_do_not_vouch_for_each_other(seen_some, world):
    for i, x in enumerate((-8.0, 14.0, -8.0)):
        view = replace(world.view(2.0, 2, 0.4, seq=4 + i), stamp_ns=(4 + i) * 10**9)
        view = spoil_pose(view, lambda T, x=x: set_at(T, (0, 3), x))
        with pytest.raises(ViewError, match="pose_jump"):
            seen_some.accept(view, None)


def test_stairs_and_a_restart_are_no_jump(seen_some, world):
    up = world.view(1.0, 2, 0, seq=4, floor="1", floor_z=2.8)
    up = spoil_pose(replace(up, stamp_ns=4 * 10**9), lambda T: set_at(T, (1, 3), 9.0))
    assert seen_some.accept(up, None).floor == "1"
    again = replace(world.view(5.0, 2, 0, seq=0), stamp_ns=5 * 10**9)  # restarted where it charges
    assert seen_some.accept(again, None).floor == "0"
    assert seen_some.validator.missed == {}


def test_an_episodes_stamps_pass(world, tools):
    """In one process robots are stamped by their number and cameras not at all."""
    joint = JointMap()
    for view in range(13):
        view = replace(world.view(5, 3, 0.5 * view, -0.5, height=1.8, source="camera/c", view=view, seq=1), stamp_ns=0)
        assert joint.accept(view, tools.seen()) is not None
    for i in range(5):
        view = world.view(1 + 0.25 * i, 2, 0, seq=i)
        assert view.stamp_ns == i
        assert joint.accept(view, tools.seen()) is not None
    assert joint.revision == 18


def test_a_camera_that_was_restarted_or_moved_is_believed(seen_some, world):
    def sees(x, seq, stamp_ns):
        view = world.view(x, 3, -2.4, -0.5, height=1.8, source="camera/c", seq=seq)
        return seen_some.accept(replace(view, stamp_ns=stamp_ns), None)

    assert sees(5, 1, 10) is not None
    assert sees(1, 1, 20) is not None  # it counts from 1 again, and hangs elsewhere
    assert sees(1, 1, 20) is None
    with pytest.raises(ViewError, match="pose_jump"):
        sees(5, 2, 30)
    assert sees(5, 3, 40) is not None


def test_no_number_is_missed_so_often_that_it_cannot_be_kept(seen_some, world):
    for seq in (2**64 - 1, 5, 2**64 - 1):
        view = spoil_pose(world.view(2.6, 2, 0.4, seq=seq), lambda T: set_at(T, (0, 3), 2.6))
        seen_some.validator.record_arrival(view, seen_some.validator.validate(view))
    assert seen_some.validator.missed == {"robot/r": 2**53}
    assert pack(seen_some.validator.missed)


def test_another_floor_name_alone_is_no_stair(seen_some, world):
    view = replace(world.view(2.6, 2, 0.4, seq=4, floor="7"), stamp_ns=4 * 10**9)
    with pytest.raises(ViewError, match="pose_jump"):
        seen_some.accept(spoil_pose(view, lambda T: set_at(T, (0, 3), T[0, 3] + 4)), None)
    assert seen_some.accept(view, None) is not None


def test_a_full_memory_of_doubts_is_kept_up_to_date(world):
    joint = JointMap(FusionConfig(validation=ValidationConfig(max_sources=1)))
    joint.accept(world.view(1, 2, 0, seq=1), None)
    for seq, x in ((2, 5.0), (3, -9.0)):
        with pytest.raises(ViewError, match="pose_jump"):
            joint.accept(world.view(x, 2, 0, seq=seq), None)
    assert joint.accept(world.view(-9.0, 2, 0, seq=4), None) is not None  # it stands by the second jump


def test_names_come_with_views_that_were_taken_and_are_bounded(seen_some, world):
    before = dict(seen_some._name_of)
    for floor_z in (0.0, 2.8):
        with pytest.raises(ViewError, match="out_of_map"):
            seen_some.integrate(far_off(world.view(2.6, 2, 0.4, floor="attic", floor_z=floor_z)), None)
    assert seen_some._name_of == before
    for i in range(300):
        seen_some._record_name(world.view(2.6, 2, 0.4, floor=f"f{i}"), seen_some._floors["0"])
    assert len(seen_some._name_of) == 256
    assert (seen_some.knows("f0"), seen_some.knows("f299")) == (True, False)
