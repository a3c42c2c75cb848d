"""A search without rendering: true obstacles as far as the robot has seen, and things it knows once they were in sight."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from surveilnav.benchmark.policies import Task, Truth
from surveilnav.messages import ObjectRecord
from surveilnav.robot_state import RobotState
from surveilnav.services.planner.core import FloorMaps, RobotView
from surveilnav.services.planner.core.motion.drive import FmmPlanner
from surveilnav.services.planner.core.motion.terrain import lines_are_clear
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world import robot_motion
from surveilnav.simulator.world.goals import find_goals, judge, sample_start
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster

SIGHT_M = 3.0


class Home:
    """A building and its truth."""

    def __init__(self, name):
        self.scene = open_building(name)
        self.navigation = NavigationMap.build(self.scene)
        self.caster = RayCaster(self.scene)

    def goals(self, target):
        return find_goals(self.scene, self.navigation, target, caster=self.caster)

    def start(self, goals, seed=0):
        return sample_start(self.scene, self.navigation, goals, seed=seed, caster=self.caster)


class Model:
    """In place of a language model on a server: the nearest place has the highest score."""

    def ask(self, system, text, parse):
        """See ``LanguageModel``."""
        n = len(text.splitlines()) - 2
        return parse(str([1.0 - i / n for i in range(n)]))


class Search:
    """One episode. ``value(x, y)`` paints the value map."""

    def __init__(self, home, policy, goals, start, *, seed=0, max_steps=500, value=lambda x, y: 0.5 + 0 * x):
        self.home, self.goals, self.start = home, goals, start
        self.state = RobotState(*start.p_m, start.floor, start.yaw_rad)
        self.stairs = tuple(robot_motion.stairs_in(home.navigation))
        self.explored = {n: np.zeros(f.grid.shape, bool) for n, f in home.navigation.floors.items()}
        self.value, self.known = value, {}
        truth = Truth(goals, home.navigation) if policy.needs_truth else None
        model = Model() if policy.needs_language_model else None
        self.searcher = policy.begin(Task(goals.label, seed, max_steps, FmmPlanner(), truth, model))
        self.actions, self.last = [], None

    def look(self):
        floor, here = self.home.navigation.floors[self.state.floor], np.array((self.state.x_m, self.state.y_m))
        (row0, col0), (row1, col1) = floor.grid.cells_of(np.array([here - SIGHT_M, here + SIGHT_M]))
        cells = np.mgrid[row0:row1, col0:col1].reshape(2, -1).T
        cells = cells[floor.grid.contains(cells)]
        away = np.linalg.norm(floor.grid.centres_of(cells) - here, axis=1)
        cells = cells[away <= SIGHT_M]
        start = np.broadcast_to(floor.grid.cells_of(here), cells.shape)
        seen = cells[lines_are_clear(floor.obstacle, cells, start, 0.0)]
        self.explored[floor.id][seen[:, 0], seen[:, 1]] = True
        points = floor.grid.centres_of(seen)
        for thing in self.home.scene.instances:
            if thing.floor == floor.id and thing.id in self.home.scene.labels_by_id:
                low, high = np.array(thing.p_min[:2]), np.array(thing.p_max[:2])
                if (np.linalg.norm(points - np.clip(points, low, high), axis=1) < 0.15).any():
                    self.known[thing.id] = record_of(thing)

    def maps(self):
        floor = self.home.navigation.floors[self.state.floor]
        explored = self.explored[floor.id].astype(np.uint8)
        seen = cv2.dilate(explored, np.ones((3, 3), np.uint8))
        occupancy = (floor.obstacle & (seen == 1)).astype(np.uint8)
        wall = cv2.dilate(occupancy, np.ones((5, 5), np.uint8))
        beside = cv2.dilate(1 - explored, np.ones((3, 3), np.uint8))
        frontier = ((explored == 1) & (wall == 0) & (beside == 1)).astype(np.uint8)
        rows, cols = np.nonzero(explored)
        points, value = (
            floor.grid.centres_of(np.column_stack([rows, cols])),
            np.full(floor.grid.shape, np.nan, np.float32),
        )
        value[rows, cols] = self.value(points[:, 0], points[:, 1])
        things = [r for r in self.known.values() if r.floor == floor.id]
        return FloorMaps(floor.id, floor.z_m, floor.grid, occupancy, explored, frontier, value, things, self.state.seq)

    def step(self):
        """Whether the episode goes on."""
        s = self.state
        self.look()
        view = RobotView(
            s.seq, s.x_m, s.y_m, s.yaw_rad, s.pitch_rad, s.floor, s.collided, s.last_action, s.path_m, self.stairs
        )
        self.last = self.searcher.act(self.maps(), view, {})
        self.actions.append(self.last.action)
        if self.last.action and not robot_motion.refusal(s, self.last.action, self.home.navigation, self.last.to_floor):
            self.state = robot_motion.act(s, self.last.action, self.home.navigation, self.last.to_floor)
        return not self.last.finished

    def run(self):
        """The simulator's verdict."""
        for _ in range(1000):
            if not self.step():
                return judge(self.goals, self.state, shortest_path_m=self.start.shortest_path_m)
        raise AssertionError("it never ended")


def record_of(thing):
    """What fusion would know of an instance seen well."""
    low, high = np.array(thing.p_min), np.array(thing.p_max)
    centre, size = (low + high) / 2, high - low
    x, y = np.meshgrid(np.linspace(low[0], high[0], 12), np.linspace(low[1], high[1], 12))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, centre[2])]).astype(np.float32)
    return ObjectRecord(
        id=thing.id,
        label=thing.label,
        floor=thing.floor,
        status="confirmed",
        confidence=0.8,
        confidence_robot=0.8,
        confidence_surveillance=0.0,
        label_robot=thing.label,
        label_surveillance="",
        n_detections=5,
        n_points=len(points),
        center_m=tuple(map(float, centre)),
        size_m=tuple(map(float, size)),
        first_seen_ns=0,
        last_seen_ns=0,
        sources=[],
        reason="",
        label_scores={thing.label: 0.8},
        points=points.tobytes(),
    )


@pytest.fixture(scope="session")
def flat():
    return Home("parametric_flat")


@pytest.fixture(scope="session")
def house():
    return Home("parametric_house")


@pytest.fixture
def search():
    """The class ``Search``."""
    return Search
