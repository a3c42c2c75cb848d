"""What a planning step costs; for CPU time add ``--benchmark-timer=time.process_time``.

``test_whole_robot_step``: a view into the joint maps, the layers, and the planner's step, on the views of one search of
an example home (a home made in code where its assets can't be had); ``extra_info`` holds median and 99th percentile over
all steps of the search. ``test_steps_of_a_search``: the same over searches of the golden run and one in a large office, as
they are played. ``test_field``: the travel-time field alone.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.benchmark import canary
from surveilnav.benchmark.play.episode import Episode, floor_maps
from surveilnav.benchmark.play.sight import Sight
from surveilnav.benchmark.policies import mission as mission_policy
from surveilnav.errors import AssetError
from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.robot_state import RobotState
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView, step
from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.motion.terrain import build_terrain, travel_time_m
from surveilnav.services.planner.core.options.frontiers import by_chance_per_metre, frontiers
from surveilnav.services.planner.core.sequence import least_expected_way
from surveilnav.services.robot_node.core import status_message
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.goals import find_goals, sample_start

MODEL = ClassSpace.model
HOME, SUBSTITUTE, TARGET, STEPS = "4_bedroom", "parametric_house", "tv", 150
ROBOT = RobotView(0, 2.0, 2.0, 0.3, 0.0, "0", False, None, 0.0)


def flat(side_cells: int) -> FloorMaps:
    """A home of rooms of 4 m with doors of 0.8 m, a third of it unexplored."""
    grid = Grid(0.0, 0.0, 0.05, side_cells, side_cells)
    occupancy = np.zeros(grid.shape, np.uint8)
    for at in range(0, side_cells, 80):
        occupancy[at : at + 2] = occupancy[:, at : at + 2] = 1
    for at in range(0, side_cells, 80):
        for door in range(40, side_cells, 80):
            if at:
                occupancy[at : at + 2, door - 8 : door + 8] = occupancy[door - 8 : door + 8, at : at + 2] = 0
    explored = np.ones(grid.shape, np.uint8)
    explored[:, -side_cells // 3 :] = 0
    frontier = np.zeros(grid.shape, np.uint8)
    frontier[:, -side_cells // 3 - 1] = 1 - occupancy[:, -side_cells // 3 - 1]
    value = np.random.default_rng(0).random(grid.shape).astype(np.float32)
    return FloorMaps("0", 0.0, grid, occupancy, explored, frontier, value, [], 1)


@pytest.mark.parametrize("side_cells", [200, 400])
@pytest.mark.parametrize("goal", ["frontier", "object"])
def test_step(benchmark, side_cells, goal):
    maps = flat(side_cells)
    if goal == "object":
        maps = replace(maps, objects=[bed(1, side_cells * 0.05 - 3.0, side_cells * 0.05 - 2.0)])
    state = MissionState("bed", floor="0", floors={"0": FloorMemory(scan_turns_left=0)})
    _, decision = benchmark(step, state, maps, ROBOT, PlannerConfig())
    assert decision.action is not None
    assert decision.phase == ("exploring" if goal == "frontier" else "approaching")


@pytest.mark.parametrize("side_cells", [200, 400])
def test_field(benchmark, side_cells):
    """Travel time from a goal to every cell of the map."""
    terrain = build_terrain(flat(side_cells), ROBOT, MissionState("bed"), PlannerConfig())
    goals = terrain.disc(side_cells * 0.05 - 3.0, side_cells * 0.05 - 2.0, 0.3)
    benchmark(travel_time_m, terrain.speed, goals, 0.05)


def bed(id: int, x_m: float, y_m: float, size_m: tuple[float, float, float] = (1.4, 2.0, 0.6)) -> ObjectRecord:
    """A bed that fusion confirmed."""
    return ObjectRecord(
        id=id,
        floor="0",
        label="bed",
        status="confirmed",
        confidence=0.9,
        confidence_robot=0.0,
        confidence_surveillance=0.9,
        label_robot="",
        label_surveillance="bed",
        n_detections=4,
        n_points=400,
        center_m=(x_m, y_m, 0.5),
        size_m=size_m,
        first_seen_ns=0,
        last_seen_ns=0,
        sources=[],
        reason="",
    )


def test_unreachable_targets(benchmark):
    """All is explored, and twenty confirmed targets stand where no way leads: each is tried, and fails, four times in a step."""
    maps = flat(400)
    occupancy = maps.occupancy.copy()
    occupancy[80:242, 80:242] = 1
    beds = [bed(i, 6.2 + i % 5 * 0.9, 6.2 + i // 5 * 1.0, (0.4, 0.4, 0.6)) for i in range(20)]
    seen, none = np.ones_like(maps.explored), np.zeros_like(maps.frontier)
    maps = replace(maps, occupancy=occupancy, explored=seen, frontier=none, objects=beds)
    state = MissionState("bed", floor="0", floors={"0": FloorMemory(scan_turns_left=0)})
    after, _ = benchmark(step, state, maps, ROBOT, PlannerConfig())
    assert [entry.failures for entry in after.here.blacklist.entries] == [4] * 20


def test_order_of_options(benchmark):
    """``choice=sequence``: the choice among the frontiers of a map of 20 m alone."""
    config = PlannerConfig(choice="sequence")
    state = MissionState("bed", floor="0", floors={"0": FloorMemory(scan_turns_left=0)})
    context = StepContext.from_inputs(state, flat(400), ROBOT, config, FmmPlanner(), {}, by_chance_per_metre)
    options = frontiers(context)
    assert len(options) >= config.sequence_options
    benchmark(least_expected_way, options, context)


#: Searches of the golden run.
GOLDEN = ("alone", "an office", "upstairs by what cameras report", "a worse detector, wrong cameras")
#: One that goes through a large office, 29 m by 20 m.
LARGE = canary.Search(
    name="a large office",
    building="office_200",
    seed=1,
    cameras=5,
    target="toilet",
    start=canary.Place(floor="0", x_m=3.025, y_m=0.875, yaw_rad=2.697),
    run={"max_steps": 250},
)


@pytest.mark.parametrize("name", [*GOLDEN, LARGE.name])
def test_steps_of_a_search(benchmark, monkeypatch, name):
    """Fusing the robot's view, the layers, and the planner's step, at every step of a search; of each step the faster of two
    times played. Steps at which cameras' views arrive are left out: fusing those isn't part of the robot's step."""
    fuse, plan = Episode.fuse, mission_policy.step
    took_ms: list[tuple[float, float]] = []
    fused_ms, is_of_robot = 0.0, True

    def timed_fuse(episode, seen, arrived):
        nonlocal fused_ms, is_of_robot
        began = time.process_time()
        fused = fuse(episode, seen, arrived)
        fused_ms, is_of_robot = 1e3 * (time.process_time() - began), not arrived
        return fused

    def timed_plan(*inputs):
        began = time.process_time()
        planned = plan(*inputs)
        if is_of_robot:
            took_ms.append((fused_ms, 1e3 * (time.process_time() - began)))
        return planned

    monkeypatch.setattr(Episode, "fuse", timed_fuse)
    monkeypatch.setattr(mission_policy, "step", timed_plan)
    search = next(s for s in (*canary.read().searches, LARGE) if s.name == name)
    rounds = []

    def play():
        took_ms.clear()
        canary.play(search)
        rounds.append(np.array(took_ms))

    benchmark.pedantic(play, rounds=2)
    fastest = np.minimum(*rounds)
    say(benchmark, f"{name}, {len(fastest)} steps: whole step", fastest.sum(axis=1))
    say(benchmark, f"{name}, {len(fastest)} steps: planner", fastest[:, 1])


def say(benchmark, name, ms):
    """Prints and keeps the median, the 99th percentile and the maximum."""
    said = {"median": np.median(ms), "p99": np.percentile(ms, 99), "max": np.max(ms)}
    benchmark.extra_info[name] = {k: round(float(v), 1) for k, v in said.items()}
    print(f"{name}: " + ", ".join(f"{k} {v:.1f} ms" for k, v in said.items()))


@pytest.fixture(scope="module")
def search():
    """One search of a home, looked at from a place where it can be played again: views, what the planner was told."""
    try:
        building = SimulatedBuilding(SimulationSettings(building=HOME))
        building.prepare()
    except AssetError:
        building = SimulatedBuilding(SimulationSettings(building=SUBSTITUTE))
        building.prepare()
    backend = choose_backend("simulated")
    sight = Sight(building, backend)
    goals = find_goals(building.scene, building.navigation, TARGET, caster=building.caster)
    start = sample_start(building.scene, building.navigation, goals, seed=0, caster=building.caster)
    text = backend.embed_texts([f"seems like there is a {TARGET}"])[0]
    cameras = [v for info in sight.infos if info.floor == start.floor for v in sight.camera(info.camera)]
    joint, state = JointMap(), RobotState(*start.p_m, start.floor, start.yaw_rad)
    mission = MissionState("no such thing", max_steps=STEPS + 1)  # so the search goes on to the last step
    for camera in cameras:
        joint.integrate(camera.view, camera.perception)
    steps = []
    while len(steps) < STEPS:
        seen = sight.robot(state)
        placed = joint.integrate(seen.view, seen.perception)
        told = RobotView.from_status(status_message(state, robot="r1"), "", ())
        mission, decision = step(mission, floor_maps(joint, placed.floor, text, MODEL), told, PlannerConfig())
        steps.append((seen.view, seen.perception, told, decision.action))
        if decision.finished:
            break
        state = robot_motion.act(state, decision.action, building.navigation)
    return cameras, steps, text


def test_whole_robot_step(benchmark, search):
    """Detector and embeddings left out: they are recorded."""
    cameras, steps, text = search
    cpu_ms, plan_ms = [], []

    def play():
        joint, mission = JointMap(), MissionState("no such thing", max_steps=STEPS + 1)
        for camera in cameras:
            joint.integrate(camera.view, camera.perception)
        joint.layer(steps[0][0].floor, "value", text, MODEL)
        for view, perception, told, action in steps:
            begin = time.process_time()
            placed = joint.integrate(view, perception)
            maps = floor_maps(joint, placed.floor, text, MODEL)
            mapped = time.process_time()
            mission, decision = step(mission, maps, told, PlannerConfig())
            end = time.process_time()
            assert decision.action == action
            cpu_ms.append(1e3 * (end - begin))
            plan_ms.append(1e3 * (end - mapped))

    benchmark.pedantic(play, rounds=2, warmup_rounds=1)
    warm = len(steps)  # the first round compiles
    benchmark.extra_info["steps"] = len(steps)
    for name, ms in (("whole step", cpu_ms[warm:]), ("planner", plan_ms[warm:])):
        say(benchmark, name, ms)
