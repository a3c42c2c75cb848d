"""What depth codecs and camera tiers take and lose, on rendered views of cameras, with and without a sensor's noise.

    BUILDINGS=3_bedroom,office_3 pytest -s tests/bench/bench_tiers.py

Errors are given in standard deviations of the sensor (Nguyen et al. 2012), against depth without noise. JPEG-XL is in the table
where ``imagecodecs`` is installed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import NamedTuple, get_args

import cv2
import numpy as np
import pytest

from surveilnav.benchmark.play.sight import Sight
from surveilnav.messages import Tier
from surveilnav.sensing.depth_codec import decode_depth, encode_depth
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.simulation import CAMERA_DEPTH_RANGE_M as RANGE_M
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings, noise_seed
from surveilnav.simulator.truth.choose import choose_backend

BUILDINGS = os.environ.get("BUILDINGS", "3_bedroom").split(",")
PERCEPTION = os.environ.get("PERCEPTION", "compact")
_MAX_CAMERAS = 3


class Codec(NamedTuple):
    """A way to write depth (height, width) [m] down, and to read it again."""

    encode: Callable[[np.ndarray], bytes]
    decode: Callable[[bytes], np.ndarray]


def ours(divisor: int, quantum_per_m: float) -> Codec:
    options = {"divisor": divisor, "quantum_per_m": quantum_per_m}
    return Codec(
        lambda depth_m: encode_depth(depth_m, RANGE_M, **options),
        lambda data: decode_depth(data, 1280, 1280, RANGE_M, **options),
    )


def _mm(depth_m: np.ndarray) -> np.ndarray:
    return np.rint(depth_m * 1000.0).astype(np.uint16)


def _steps(depth_m: np.ndarray) -> np.ndarray:
    known = depth_m > 0
    return np.where(known, np.rint(1000.0 / np.where(known, depth_m, 1.0)), 0).astype(np.uint16)


def _from_steps(steps: np.ndarray) -> np.ndarray:
    return np.where(steps > 0, 1000.0 / np.maximum(steps, 1), 0.0).astype(np.float32)


def png(to: Callable[[np.ndarray], np.ndarray], back: Callable[[np.ndarray], np.ndarray]) -> Codec:
    return Codec(
        lambda depth_m: cv2.imencode(".png", to(depth_m))[1].tobytes(),
        lambda data: back(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)),
    )


def codecs() -> dict[str, Codec]:
    """By name; the first is what everything is compared with."""
    found = {
        "PNG, 16 bits, mm": png(_mm, lambda mm: mm.astype(np.float32) / 1000.0),
        "PNG, inverse depth in 0.001/m": png(_steps, _from_steps),
        "inverse depth in 0.001/m, zstd (`jpeg+depth`)": ours(1, 0.001),
        "inverse depth in 0.006/m, zstd": ours(1, 0.006),
        "cells of 4 pixels, 0.006/m": ours(4, 0.006),
        "cells of 8 pixels, 0.006/m (`features`)": ours(8, 0.006),
        "cells of 16 pixels, 0.006/m": ours(16, 0.006),
    }
    try:
        import imagecodecs as more
    except ImportError:
        return found
    jxl = Codec(
        lambda depth_m: more.jpegxl_encode(_steps(depth_m), lossless=True, effort=3),
        lambda data: _from_steps(more.jpegxl_decode(data)),
    )
    return found | {"JPEG-XL, inverse depth in 0.001/m": jxl}


def views(building: SimulatedBuilding, noise: DepthNoise | None) -> list[np.ndarray]:
    plan, seed = building.plan, building.settings.seed
    return [
        building.renderer.render(
            pose.matrix(),
            plan.intrinsics,
            depth_range_m=RANGE_M,
            noise=noise,
            seed=noise_seed(seed, camera.name, view),
            colors=False,
        ).depth_m
        for camera in plan.cameras[:_MAX_CAMERAS]
        for view, pose in enumerate(camera.views)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("noisy", [True, False])
def test_codecs_of_depth(noisy):
    true, seen = [], []
    for name in BUILDINGS:
        building = SimulatedBuilding(SimulationSettings(building=name, lighting="flat"))
        exact = views(building, None)
        true += exact
        seen += views(building, DepthNoise.camera()) if noisy else exact
    print(f"\n{len(seen)} views of {', '.join(BUILDINGS)}, {'with noise' if noisy else 'without noise'}")
    print("| codec | kB a view | encode [ms] | decode [ms] | error / sigma: median, 95 %, 99 % | pixels lost |")
    print("|---|---|---|---|---|---|")
    for name, codec in codecs().items():
        n_bytes, errors, lost, times_s = 0, [], [], [0.0, 0.0]
        for truth, depth_m in zip(true, seen, strict=True):
            began_s = time.perf_counter()
            data = codec.encode(depth_m)
            encoded_s = time.perf_counter()
            back = codec.decode(data)
            times_s[0] += encoded_s - began_s
            times_s[1] += time.perf_counter() - encoded_s
            n_bytes += len(data)
            both = (truth > 0) & (back > 0)
            sigma_m = 0.0012 + 0.0019 * (truth[both] - 0.4) ** 2
            errors.append((np.abs(back[both] - truth[both]) / sigma_m)[::50])
            lost.append(((depth_m > 0) & (back == 0)).mean())
        n, share = len(seen), np.percentile(np.concatenate(errors), [50, 95, 99])
        print(
            f"| {name} | {n_bytes / n / 1e3:.1f} | {times_s[0] / n * 1e3:.0f} | {times_s[1] / n * 1e3:.0f} "
            f"| {share[0]:.2f}, {share[1]:.2f}, {share[2]:.1f} | {100 * np.mean(lost):.2f} % |"
        )


@pytest.mark.slow
def test_bytes_of_a_view_by_tier():
    backend = choose_backend(PERCEPTION)
    print(f"\nbytes of a view on the wire, {PERCEPTION}, {', '.join(BUILDINGS)}")
    print("| tier | mean | standard deviation of views | least and most of a building's mean | part of `jpeg+depth` |")
    print("|---|---|---|---|---|")
    of_tier: dict[Tier, list[list[int]]] = {}
    for name in BUILDINGS:
        building = SimulatedBuilding(SimulationSettings(building=name))
        for tier in get_args(Tier):
            sight = Sight(building, backend, camera_tier=tier)
            cameras = sight.infos[:_MAX_CAMERAS]
            of_tier.setdefault(tier, []).append([v.offered_bytes for c in cameras for v in sight.camera(c.camera)])
    usual = np.mean(np.concatenate(of_tier["jpeg+depth"]))
    for tier, buildings in of_tier.items():
        every, means = np.concatenate(buildings), [np.mean(b) for b in buildings]
        print(
            f"| `{tier}` | {every.mean():,.0f} | {every.std():,.0f} | {min(means):,.0f} to {max(means):,.0f} "
            f"| 1/{usual / every.mean():.1f} |"
        )
