"""One search: why it failed, cameras that are late, cameras that are wrong about where they hang."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from surveilnav.benchmark.play import cameras, episode
from surveilnav.benchmark.play.cameras import InvokedCameras
from surveilnav.benchmark.play.episode import REASONS, Episode, _was_seen, reason_of
from surveilnav.benchmark.play.sight import PoseError, SeenView, Sight, text_as_sent
from surveilnav.benchmark.policies import Task, policy_of
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception.prompts import value_prompt
from surveilnav.sensing.packing import pack_embedding, unpack_embedding
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.planner.core import Decision
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world.goals import find_goals, sample_start

# --- why it failed ------------------------------------------------------------------------------------------------

GOALS = SimpleNamespace(label="tv", viewpoints={"1": None})


@pytest.mark.parametrize(
    ("reason", "at_1_m", "found", "error", "seen", "floors"),
    [
        ("stopped_short", True, True, "", True, ["1"]),
        ("false_positive", False, True, "", False, ["1"]),
        ("false_positive", False, True, "", False, ["0"]),  # where it stopped says more than where it was not
        ("wrong_floor", False, False, "not_found", False, ["0", "2"]),
        ("wrong_floor", False, False, "out_of_steps", True, ["0"]),
        ("seen_and_rejected", False, False, "not_found", True, ["0", "1"]),
        ("not_seen", False, False, "not_found", False, ["1"]),
        ("not_seen", False, False, "", False, ["1"]),
        ("stuck", False, False, "stuck", True, ["1"]),
        ("unreachable", False, False, "unreachable", True, ["1"]),
        ("out_of_steps", True, False, "out_of_steps", True, ["1"]),  # beside the goal, and it never said so
    ],
)
def test_every_failure_has_its_name(reason, at_1_m, found, error, seen, floors):
    verdict = SimpleNamespace(success=False, success_at_1_m=at_1_m)
    decision = SimpleNamespace(found=found, error=error)
    assert reason_of(verdict, decision, seen, GOALS, floors) == reason
    assert reason in REASONS
    assert reason_of(SimpleNamespace(success=True), decision, seen, GOALS, floors) == ""


@dataclass
class Maps:
    """Joint maps of one floor that hold one object."""

    center_m: tuple[float, float, float]
    label_scores: dict[str, float]
    floors = ("0",)

    def objects(self, floor):
        return [SimpleNamespace(center_m=np.array(self.center_m), label_scores=self.label_scores)]


@pytest.mark.parametrize(
    ("center_m", "scores", "seen"),
    [
        ((1.0, 1.0, 0.5), {"tv": 0.1, "bed": 0.9}, True),  # whatever it is called most
        ((2.25, 1.0, 0.5), {"tv": 0.1}, True),
        ((2.35, 1.0, 0.5), {"tv": 0.9}, False),
        ((1.0, 1.0, 0.5), {"bed": 0.9}, False),
        ((1.0, 1.0, 0.5), {"tv": 0.0}, False),
        ((7.0, 1.0, 0.5), {"tv": 0.9}, True),  # one that a robot can't get to
    ],
)
def test_a_goal_was_seen_if_something_that_was_called_so_lies_there(center_m, scores, seen):
    there = SimpleNamespace(p_min=(0.0, 0.0, 0.0), p_max=(2.0, 2.0, 1.0))
    apart = SimpleNamespace(p_min=(6.0, 0.0, 0.0), p_max=(8.0, 2.0, 1.0))
    goals = SimpleNamespace(label="tv", instances=(there,), unreachable=(apart,))
    assert _was_seen(Maps(center_m, scores), goals) == seen


# --- late cameras, wrong cameras ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flat():
    return SimulatedBuilding(SimulationSettings(building="parametric_flat", lighting="flat"))


def searched(flat, steps, **how):
    """What the planner was shown at each step, and the steps at which cameras' views came into the maps."""
    backend = choose_backend("oracle")
    goals = find_goals(flat.scene, flat.navigation, "toilet", caster=flat.caster)
    start = sample_start(flat.scene, flat.navigation, goals, seed=1)
    shown, arrived = [], []
    real = InvokedCameras.in_turn
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(InvokedCameras, "in_turn", lambda *a: (arrived.append(len(shown)) if a[3] else None, real(*a))[1])
        Episode(
            Sight(flat, backend, way="depth"),
            goals,
            start,
            policy_of("surveilnav").begin(Task("toilet", 1, steps, FmmPlanner())),
            on_step=lambda n, view, joint, maps, d: shown.append(
                (d.action, maps.explored.tobytes(), maps.value.tobytes())
            ),
            **how,
        ).run()
    return shown, arrived


@pytest.mark.parametrize("delay", [0, 1, 5])
def test_views_arrive_so_many_actions_after_their_camera_was_invoked(flat, delay):
    alone, never = searched(flat, 8, surveillance=False)
    late, arrived = searched(flat, 8, delay_steps=delay)
    assert never == []
    assert arrived == [delay]  # the floor's cameras are invoked at the first step
    assert late[:delay] == alone[:delay]
    assert late[delay] != alone[delay]


def test_of_the_views_that_have_come_a_few_are_looked_at_each_step(flat):
    """The maps hold the same in the end, and all at once is what it was without an order."""
    n_views = len(Sight(flat, choose_backend("oracle"), way="depth").camera(flat.plan.cameras[0].name))
    at_once, _ = searched(flat, 3)
    slowly, _ = searched(flat, 3, views_per_step=2)
    everything, _ = searched(flat, 3, views_per_step=len(flat.plan.cameras) * n_views)
    assert everything[0] == at_once[0]
    seen = [np.frombuffer(explored, np.uint8).sum() for _, explored, _ in slowly]
    assert 0 < seen[0] < seen[1] < seen[2] < np.frombuffer(at_once[2][1], np.uint8).sum()


def test_of_a_floor_that_the_robot_left_nothing_is_looked_at_or_waited_for(monkeypatch):
    floors = {0.0: ["below"], 2.8: ["above"], 1.4: []}
    monkeypatch.setattr(cameras, "active_cameras", lambda floors_z_m, *_: floors[floors_z_m[0]])
    monkeypatch.setattr(JointMap, "view_utilities", lambda joint, views, robots: np.zeros(len(views)))
    monkeypatch.setattr(InvokedCameras, "_footprint", lambda *_: None)

    def views_of(name):
        views = [SimpleNamespace(source=f"camera/{name}", view=i) for i in range(5)]
        return [SimpleNamespace(view=view, offered_bytes=1) for view in views]

    invoked = InvokedCameras(SimpleNamespace(camera=views_of, infos=[]), FusionConfig(), 1, 2)
    seen, found = SeenView(before_a_wall(), None, 0), []
    for step, floor_z_m in enumerate((0.0, 0.0, 1.4, 2.8, 2.8, 0.0, 0.0)):
        arrived = invoked.invoke(floor_z_m, step)
        taken = list(invoked.in_turn(JointMap(), seen, arrived))
        assert taken.pop() is seen
        found.append((sorted({v.view.source for v in taken}), [v.view.view for v in taken], invoked.n_pending))
    assert found == [
        ([], [], 5),
        (["camera/below"], [0, 1], 3),
        ([], [], 0),
        ([], [], 5),
        (["camera/above"], [0, 1], 3),
        (["camera/below"], [2, 3], 1),
        (["camera/below"], [4], 0),
    ]


def test_a_stair_that_the_robot_refused_was_not_its_last_action(flat):
    """As in the running system's planner: else a step before it that hit something is taken for another one."""
    goals = find_goals(flat.scene, flat.navigation, "toilet", caster=flat.caster)
    start = sample_start(flat.scene, flat.navigation, goals, seed=1)
    plan = iter(
        [
            Decision("turn_left", "looking_around"),
            Decision("take_stairs", "to_floor", to_floor="9"),
            Decision("turn_right", "looking_around"),
            Decision(None, "finished", finished=True),
        ]
    )
    last = []
    searcher = SimpleNamespace(
        steps=0, act=lambda maps, robot, summaries: (last.append(robot.last_action), next(plan))[1]
    )
    Episode(Sight(flat, choose_backend("oracle"), way="depth"), goals, start, searcher, surveillance=False).run()
    assert last == [None, "turn_left", None, "turn_right"]


def test_a_pose_error_is_as_large_as_it_says_and_each_cameras_own():
    error = PoseError(0.1, math.radians(3.0))
    drawn = [error.drawn(name, 0) for name in ("c0-1", "c0-2")]
    for T in drawn:
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(0.1)
        assert math.acos((np.trace(T[:3, :3]) - 1) / 2) == pytest.approx(math.radians(3.0))
        assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3))
    assert not np.allclose(drawn[0], drawn[1])
    assert np.array_equal(error.drawn("c0-1", 0), drawn[0])
    assert not np.allclose(error.drawn("c0-1", 1), drawn[0])
    assert np.array_equal(PoseError().drawn("c0-1", 0), np.eye(4))


@pytest.mark.parametrize("way", ["depth", "pixels"])
def test_a_camera_that_is_wrong_about_its_place_sees_the_same_and_says_another(flat, way):
    backend = choose_backend("oracle")
    right, wrong = (
        Sight(flat, backend, way=way, pose_error=error) for error in (PoseError(), PoseError(0.1, math.radians(3.0)))
    )
    name = right.infos[0].camera
    T_true, T_said = (sight.camera(name)[0].view.T_world_camera for sight in (right, wrong))
    assert np.array_equal(right.camera(name)[0].view.depth_m, wrong.camera(name)[0].view.depth_m)
    assert np.linalg.norm(T_said[:3, 3] - T_true[:3, 3]) == pytest.approx(0.1)
    turn = T_said[:3, :3] @ T_true[:3, :3].T
    assert math.degrees(math.acos((np.trace(turn) - 1) / 2)) == pytest.approx(3.0)


def before_a_wall(depth_m=0.0):
    camera = Pinhole.from_hfov(64, 48, math.radians(79.0))
    T_world_camera = camera_pose((1.0, 2.0, 0.88), 0.0, 0.0)
    rgb, depth = np.zeros((48, 64, 3), np.uint8), np.full((48, 64), depth_m, np.float32)
    return PosedView("robot/r1", 0, 0, 1, "0", T_world_camera, camera, 0.88, rgb, depth, (0.5, 5.0))


def test_a_view_without_any_depth_is_left_out_as_on_the_bus_and_the_planner_gets_empty_maps():
    joint, view = JointMap(), before_a_wall()
    assert episode._integrate_view(joint, SeenView(view, None, 0)) == ""
    assert list(joint.floors) == []
    maps = episode.floor_maps(episode._maps_with_floor(joint, "0", view), "0", np.ones(4, np.float32) / 2, "")
    assert not maps.occupancy.any()
    assert not maps.explored.any()
    assert [int(i) for i in maps.grid.cells_of((1.0, 2.0))] == [n // 2 for n in maps.occupancy.shape]
    with pytest.raises(ViewError, match=r"shape|size|depth"):
        episode._integrate_view(joint, SeenView(replace(view, depth_m=view.depth_m[:4]), None, 0))


def test_a_view_left_out_is_still_of_the_floor_that_the_robot_stands_on():
    joint = JointMap()
    assert episode._integrate_view(joint, SeenView(before_a_wall(2.0), None, 0)) == "0"
    revision = joint.revision
    assert episode._integrate_view(joint, SeenView(replace(before_a_wall(), seq=1), None, 0)) == "0"
    assert joint.revision == revision
    assert episode._maps_with_floor(joint, "0", before_a_wall()) is joint


def test_embeddings_are_rounded_as_on_their_way_over_the_bus(flat):
    """float16: without it the value layer differs from the running system's in its fifth digit."""
    backend = choose_backend("oracle")
    seen = Sight(flat, backend, way="depth").camera(flat.plan.cameras[0].name)
    embeddings = [v.perception.image_embedding for v in seen if v.perception]
    embeddings += [d.embedding for v in seen if v.perception for d in v.perception.detections]
    embeddings.append(text_as_sent(backend, value_prompt("bed")))
    assert len(embeddings) > 3
    raw = backend.embed_texts([value_prompt("bed")])[0]
    for embedding in embeddings:
        assert np.array_equal(unpack_embedding(pack_embedding(embedding)), embedding)
    assert not np.array_equal(raw, embeddings[-1])
    assert np.allclose(raw, embeddings[-1], atol=1e-3)


def test_cameras_that_look_by_themselves_show_the_maps_the_same_home(flat):
    """With the oracle on rendered pixels: features make nearly the same maps in a hundredth of the bytes."""
    backend, camera = choose_backend("oracle"), flat.plan.cameras[0].name
    n_bytes, explored, labels = {}, {}, {}
    for tier in ("jpeg+depth", "features", "objects"):
        joint = JointMap(FusionConfig())
        seen = Sight(flat, backend, camera_tier=tier).camera(camera)
        for view in seen:
            joint.integrate(view.view, view.perception)
        (floor,) = joint.floors
        n_bytes[tier] = sum(view.offered_bytes for view in seen)
        explored[tier] = int(joint.layer(floor, "explored")[1].sum())
        labels[tier] = {o.label for o in joint.objects(floor) if o.status == "confirmed"}
    assert n_bytes["jpeg+depth"] > 60 * n_bytes["features"]
    assert n_bytes["features"] > 1.5 * n_bytes["objects"]
    assert explored["features"] == pytest.approx(explored["jpeg+depth"], rel=0.05)
    assert explored["objects"] < explored["features"]
    assert labels["features"] == labels["jpeg+depth"] != set()


def test_pictures_are_needed_for_a_tier(flat):
    with pytest.raises(ValueError, match="needs way='pixels'"):
        Sight(flat, choose_backend("oracle"), way="depth", camera_tier="features")
