"""A pose as the page shows it: numbers with their standard deviations, and what is drawn into picture and plan."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose import FloorPlan
from surveilnav.camera_pose.angles import angle_sigmas
from surveilnav.camera_pose.footprint import seen_floor
from surveilnav.camera_pose.overlay import grid_lines, projected, visible_lines, wall_lines
from surveilnav.cli.calibrating import TOO_UNCERTAIN, Calibrated, as_json, is_good, is_usable, rounded

_LINE_TOLERANCE_PX = 0.3
_REACH_M = 10.0  # of what is drawn of the camera's view on the plan


def solution(made: Calibrated, plan: FloorPlan) -> dict[str, Any]:
    """For the page: what ``--json`` prints, and besides

    ``height_m`` above the floor; ``position_sigmas_m`` of x, y, z; ``angle_sigmas_deg`` of yaw, pitch, roll;
    ``hfov_sigma_deg``, 0 if it wasn't fitted; ``is_good``: certain enough for searches; ``warning``, or "".
    ``predicted_px``: where the pose puts each point in the picture; None out of sight.
    ``grid``, ``walls``: lines in the picture. ``place_px``, ``view_px``: the camera and the outline of its view on the plan.
    """
    fit, T = made.fit, made.fit.T_world_camera
    lens = fit.lens
    sigmas_rad = angle_sigmas(T, fit.covariance[3:, 3:])
    grid = visible_lines(lens, T, grid_lines(T, made.floor_z_m))
    walls = visible_lines(lens, T, wall_lines(plan, made.floor_z_m))
    view = seen_floor(lens, T, made.floor_z_m, _REACH_M)
    return as_json(made, written=False) | {
        "height_m": round(float(T[2, 3] - made.floor_z_m), 4),
        "position_sigmas_m": [round(float(s), 4) for s in np.sqrt(np.diag(fit.covariance)[:3])],
        "angle_sigmas_deg": [round(math.degrees(s), 3) for s in sigmas_rad],
        "hfov_sigma_deg": round(math.degrees(fit.hfov_sigma_rad), 3),
        "is_good": is_good(fit),
        "warning": "" if is_usable(fit) else TOO_UNCERTAIN,
        "predicted_px": [
            None if rounded(u, 2) is None else [rounded(u, 2), rounded(v, 2)]
            for u, v in projected(lens, T, made.p_world)
        ],
        "grid": _as_lists(grid),
        "walls": _as_lists(walls),
        "place_px": plan.pixels_of(T[:3, 3]).round(2).tolist(),
        "view_px": plan.pixels_of(view).round(1).tolist(),
    }


def _as_lists(lines: list[NDArray[np.float64]]) -> list[list[list[float]]]:
    """Lines (n, 2) with the points left out that lie between others on a straight line."""
    fewer = (cv2.approxPolyDP(line.astype(np.float32), _LINE_TOLERANCE_PX, False)[:, 0] for line in lines)
    return [np.round(line.astype(np.float64), 1).tolist() for line in fewer]
