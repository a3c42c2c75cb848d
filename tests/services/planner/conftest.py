"""A flat world for the planner: walls drawn in text, a robot with a fan of rays, and objects it comes to see."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest

from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord, Stair
from surveilnav.services.planner.core import FloorMaps, MissionState, PlannerConfig, RobotView, step

R = 0.05
CHAR_M = 0.25  # one character of a drawing is 5 x 5 cells
K = round(CHAR_M / R)


def record(id=1, label="chair", at=(1.0, 1.0), size=(0.5, 0.5), **changes):
    """An object record with sensible defaults."""
    base = {
        "floor": "0",
        "status": "candidate",
        "confidence": 0.6,
        "confidence_robot": 0.0,
        "confidence_surveillance": 0.0,
        "label_robot": "",
        "label_surveillance": "",
        "n_detections": 1,
        "n_points": 100,
        "center_m": (at[0], at[1], 0.5),
        "size_m": (size[0], size[1], 1.0),
        "first_seen_ns": 0,
        "last_seen_ns": 0,
        "sources": [],
        "reason": "",
    }
    return ObjectRecord(id=id, label=label, **(base | changes))


@dataclass
class Thing:
    """An object of the drawing. ``looks_like``: what the robot takes it for when near; ``known``: what cameras said."""

    label: str
    cells: np.ndarray
    looks_like: str = ""
    confidence_robot: float = 0.0
    detections: int = 0
    known: dict = field(default_factory=dict)


class World:
    """``#`` wall, ``R`` robot, letters objects (see ``things``), anything else free."""

    def __init__(self, drawing, things=None, yaw_rad=0.0, range_m=5.0, sees_from_m=3.5, floor="0"):
        self.floor = floor
        lines = list(drawing.strip("\n").splitlines())[::-1]  # first row of the text is north
        width = max(len(line) for line in lines)
        chars = np.array([list(line.ljust(width)) for line in lines])
        fine = np.repeat(np.repeat(chars, K, axis=0), K, axis=1)
        pad = 20
        fine = np.pad(fine, pad, constant_values=" ")
        self.grid = Grid(-pad * R, -pad * R, R, *fine.shape)
        self.things = things or {}
        for mark, thing in self.things.items():
            thing.cells = np.argwhere(fine == mark)
        self.solid = np.isin(fine, ["#", *self.things])
        self.mark = fine
        self.clearance_m = cv2.distanceTransform((~self.solid).astype(np.uint8), cv2.DIST_L2, 5) * R
        row, col = np.argwhere(chars == "R")[0]
        self.x, self.y, self.yaw, self.pitch = (col + 0.5) * CHAR_M, (row + 0.5) * CHAR_M, yaw_rad, 0.0
        self.range_m, self.sees_from_m = range_m, sees_from_m
        self.occupancy = np.zeros(fine.shape, np.uint8)
        self.explored = np.zeros(fine.shape, np.uint8)
        self.seq, self.path_m, self.collided, self.last = 0, 0.0, False, None
        self.trace = [(self.x, self.y)]
        self.value = np.full(fine.shape, np.nan, np.float32)
        self.look()

    def look(self):
        angles = self.yaw + np.radians(np.linspace(-39.5, 39.5, 240))
        s = np.arange(0.0, self.range_m, R / 2)
        x = self.x + np.cos(angles)[:, None] * s
        y = self.y + np.sin(angles)[:, None] * s
        cells = np.clip(self.grid.cells_of(np.stack([x, y], -1)), 0, np.array(self.grid.shape) - 1)
        hit = self.solid[cells[..., 0], cells[..., 1]]
        first = np.where(hit.any(1), hit.argmax(1), s.size)
        for ray, n in zip(cells, first, strict=True):
            self.explored[ray[: n + 1, 0], ray[: n + 1, 1]] = 1
            if n < s.size:
                self.occupancy[tuple(ray[n])] = 1
        near = min(self.sees_from_m, self.range_m)
        seen = {self.mark[tuple(ray[n])] for ray, n in zip(cells, first, strict=True) if n * R / 2 < near}
        for mark, thing in self.things.items():
            if mark in seen and thing.looks_like:
                thing.detections += 1
                thing.confidence_robot = 0.7
        here = (self.grid.cells_of((self.x, self.y)) + np.mgrid[-3:4, -3:4].reshape(2, -1).T).T
        self.explored[here[0], here[1]] = 1

    def objects(self):
        found = []
        for i, thing in enumerate(self.things.values()):
            if not thing.known and not thing.detections:
                continue
            xy = self.grid.centres_of(thing.cells)
            points = np.column_stack([xy, np.full(len(xy), 0.4)]).astype(np.float32)[:256]
            by_robot = thing.confidence_robot >= thing.known.get("confidence", 0.0)
            label = thing.looks_like if by_robot else thing.known["label"]
            facts = {
                "label": label,
                "points": points.tobytes(),
                "at": tuple(map(float, xy.mean(0))),
                "size": tuple(map(float, np.ptp(xy, axis=0) + R)),
                "n_detections": thing.detections + 1,
                "confidence_robot": thing.confidence_robot,
                "label_robot": thing.looks_like if thing.detections else "",
                "label_surveillance": thing.known.get("label", ""),
                "confidence_surveillance": thing.known.get("confidence", 0.0),
                "confidence": max(thing.confidence_robot, thing.known.get("confidence", 0.0)),
                "status": "confirmed" if thing.detections >= 3 else thing.known.get("status", "candidate"),
            }
            found.append(record(id=i + 1, **facts))
        return found

    def maps(self):
        wall = cv2.dilate(self.occupancy, np.ones((5, 5), np.uint8))
        beside = cv2.dilate(1 - self.explored, np.ones((3, 3), np.uint8))
        frontier = ((self.explored == 1) & (wall == 0) & (beside == 1)).astype(np.uint8)
        occupancy, explored = self.occupancy.copy(), self.explored.copy()
        return FloorMaps(
            self.floor, 0.0, self.grid, occupancy, explored, frontier, self.value, self.objects(), self.seq
        )

    def robot(self):
        return RobotView(
            self.seq,
            float(self.x),
            float(self.y),
            self.yaw,
            self.pitch,
            self.floor,
            self.collided,
            self.last,
            self.path_m,
        )

    def act(self, action):
        self.collided, self.last = False, action
        if action == "turn_left":
            self.yaw += math.pi / 6
        elif action == "turn_right":
            self.yaw -= math.pi / 6
        elif action == "look_down":
            self.pitch -= math.pi / 6
        elif action == "look_up":
            self.pitch += math.pi / 6
        elif action == "move_forward":
            for _ in range(25):
                x, y = self.x + 0.01 * math.cos(self.yaw), self.y + 0.01 * math.sin(self.yaw)
                row, col = self.grid.cells_of((x, y))
                if self.clearance_m[row, col] < 0.18:
                    self.collided = True
                    break
                self.x, self.y, self.path_m = x, y, self.path_m + 0.01
        self.seq += 1
        self.trace.append((self.x, self.y))
        self.look()

    def run(self, target="chair", config=None, max_steps=500, watch=None):
        """Plays a mission to its end; returns the last state and decision."""
        state = MissionState(target, max_steps=max_steps)
        config = config or PlannerConfig()
        for _ in range(max_steps + 2):
            maps, robot = self.maps(), self.robot()
            state, decision = step(state, maps, robot, config)
            if watch:
                watch(maps, robot, state, decision)
            if decision.finished:
                return state, decision
            self.act(decision.action)
        raise AssertionError("the mission never ended")

    def gap_m(self, mark):
        """Plan distance from the robot to an object."""
        xy = self.grid.centres_of(self.things[mark].cells)
        return float(np.hypot(xy[:, 0] - self.x, xy[:, 1] - self.y).min())


class House:
    """Floors (``World`` each, the first that the robot is on) and stairs, both ways:
    (floor, (x, y), to_floor, (x, y)[, length])."""

    def __init__(self, floors, stairs, summaries=None, refuses=0):
        self.floors = {w.floor: w for w in floors}
        self.now = floors[0]
        self.stairs = tuple(
            Stair(floor=a, to_floor=b, at_m=(*p, 0.0), to_m=(*q, 0.0), length_m=length[0] if length else 4.0)
            for one in stairs
            for a, p, b, q, *length in (one, (*one[2:4], *one[:2], *one[4:]))
        )
        self.summaries = summaries or {}
        self.refuses, self.refused = refuses, 0
        self.trail = [self.now.floor]

    def robot(self):
        return replace(self.now.robot(), stairs=self.stairs)

    def act(self, decision):
        if decision.action != "take_stairs":
            self.now.act(decision.action)
            return
        here = self.now.x, self.now.y
        stair = min(
            (s for s in self.stairs if (s.floor, s.to_floor) == (self.now.floor, decision.to_floor)),
            key=lambda s: math.dist(s.at_m[:2], here),
        )
        assert math.dist(stair.at_m[:2], here) <= 0.5
        if self.refused < self.refuses:
            self.refused += 1
            return
        old, self.now = self.now, self.floors[stair.to_floor]
        self.now.x, self.now.y, self.now.yaw, self.now.pitch = *stair.to_m[:2], old.yaw, old.pitch
        self.now.seq, self.now.path_m, self.now.last, self.now.collided = (
            old.seq + 1,
            old.path_m + 4.0,
            "take_stairs",
            False,
        )
        self.trail.append(self.now.floor)
        self.now.look()

    def run(self, target="chair", config=None, max_steps=500, watch=None, state=None):
        """Plays a mission to its end; returns the last state and decision."""
        state = state or MissionState(target, max_steps=max_steps)
        for _ in range(max_steps + 2):
            robot, maps = self.robot(), self.now.maps()
            state, decision = step(state, maps, robot, config or PlannerConfig(), summaries=self.summaries)
            if watch:
                state = watch(state, decision) or state
            if decision.finished:
                return state, decision
            self.act(decision)
        raise AssertionError("the mission never ended")


@pytest.fixture
def house():
    """The class ``House``."""
    return House


@pytest.fixture
def world():
    """The class ``World``."""
    return World


@pytest.fixture
def thing():
    """Makes a ``Thing``."""
    return lambda label, **facts: Thing(label, np.zeros((0, 2), int), **facts)


@pytest.fixture
def make_record():
    """Makes an ``ObjectRecord``."""
    return record
