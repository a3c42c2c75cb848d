"""A camera made here, whose pictures the tests change."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import Pinhole, Pose, camera_pose
from surveilnav.messages import StreamStatus
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.camera_node.sources.source import Picture, Place

SIDE = 64
VIEWS = [Pose.from_matrix(camera_pose((1.0, 2.0, 1.8), k * math.pi / 6, math.radians(-30))) for k in range(12)]
NADIR = Pose.from_matrix(camera_pose((1.0, 2.0, 1.8), 0.0, -math.pi / 2))


class Camera:
    """A source of 13 views that shows instance 1, a bed, in view 3, and nothing elsewhere.

    ``versions``: of each view, 0 at first; ``real``: it knows no instance ids; ``asked``: the views whose pictures
    were asked for; ``scene``: what its views show, the same in every run; empty: nobody knows.
    """

    place = Place("c1", "0", (1.0, 2.0, 1.8), 1.8)
    views = [*VIEWS, NADIR]
    intrinsics = Pinhole.from_hfov(SIDE, SIDE, math.radians(100.0))
    depth_range_m = (0.3, 10.0)
    has_depth = True
    stream = StreamStatus()

    def __init__(self, real=False, scene=""):
        self.versions, self.real, self.asked, self.scene = dict.fromkeys(range(13), 0), real, [], scene

    def version(self, view):
        return self.versions[view]

    def content(self, view):
        return f"{self.scene} {view}" if self.scene else ""

    def latest(self, view):
        self.asked.append(view)
        rgb = np.full((SIDE, SIDE, 3), 99 + self.versions[view], np.uint8)
        ids = np.full((SIDE, SIDE), view == 3, np.uint16)
        truth = None if self.real else TrueInstances(ids, {1: "bed"}, self.views[view].matrix())
        return Picture(self.versions[view], rgb, np.full((SIDE, SIDE), 2.0, np.float32), truth)


@pytest.fixture
def make_camera():
    """``make_camera(real=False, scene="")``: see ``Camera``."""
    return Camera


@pytest.fixture
def camera_node(make_node):
    return make_node("camera", "c1")
