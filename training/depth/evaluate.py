"""What the depth network finds in views of buildings that training never saw, as tables in Markdown.

    python -m training.depth.evaluate --network runs/depth/depth.onnx --views data/depth/val [--card]

``--card`` adds the figures to ``card.json`` beside the network.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.depth.network import DepthNetwork
from surveilnav.perception.depth.reference import reference_depth
from surveilnav.perception.runtime import Runtime
from training.depth.card import Band, Floor, Measured, card_of, save_card
from training.depth.floor import floor_mask
from training.depth.pack import DepthView, Pack, ViewGeometry, read_packs

T = TypeVar("T", bound=np.generic)

BANDS_M = ((0.0, 2.0), (2.0, 4.0), (4.0, 6.0), (6.0, 10.0))
#: Depth that differs by less from the floor's is the floor's.
_FLOOR_LOG_RATIO = 0.03
_HIGHER_M = 0.1
#: Pixels and rows between samples.
_STEP = 3
#: The errors of an imprecise calibration: share of the height, pitch.
_HEIGHT_ERROR, _PITCH_ERROR_RAD = 0.03, math.radians(1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Pixels of views, all (N,).

    Attributes:
        true_m, depth_m, reference_m: true, estimated (0: unknown) and reference depth.
        sigma_log: uncertainty of the logarithm of the estimated depth.
        is_floor, higher: whether the pixel shows the floor; whether it shows something 10 cm above it.
        over_floor: whether the pixel's reference is the floor.
    """

    true_m: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    reference_m: NDArray[np.float32]
    sigma_log: NDArray[np.float32]
    is_floor: NDArray[np.bool_]
    higher: NDArray[np.bool_]
    over_floor: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        return self.depth_m > 0.0

    @property
    def error(self) -> NDArray[np.float32]:
        """Absolute error of the logarithm of depth; inf where it is unknown."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.abs(np.log(self.depth_m / self.true_m)))

    @property
    def taken_for_floor(self) -> NDArray[np.bool_]:
        with np.errstate(divide="ignore"):
            near: NDArray[np.bool_] = np.abs(np.log(self.depth_m / self.reference_m)) < _FLOOR_LOG_RATIO
        return near & self.over_floor


def samples_of(network: Path, packs: Sequence[Pack], *, imprecise: bool = False) -> Samples:
    """Runs the network on all views. ``imprecise``: with a calibration that is wrong by 3 % of the height and 1 degree."""
    opened = DepthNetwork(network, Runtime(device="cpu"))
    rng = np.random.default_rng(0)
    rows = []
    for pack in packs:
        for i in range(len(pack.views)):
            view = pack.view(i)
            shown = _wrong(view.geometry, rng) if imprecise else view.geometry
            rows.append(_samples_of_view(opened, view, shown))
    return joined(rows)


def joined(rows: Sequence[Samples]) -> Samples:
    """All samples together."""
    return Samples(*(np.concatenate([getattr(row, field.name) for row in rows]) for field in fields(Samples)))


def _wrong(geometry: ViewGeometry, rng: np.random.Generator) -> ViewGeometry:
    signs = rng.choice((-1.0, 1.0), 2)
    return msgspec.structs.replace(
        geometry,
        height_m=geometry.height_m * (1.0 + signs[0] * _HEIGHT_ERROR),
        pitch_rad=geometry.pitch_rad + signs[1] * _PITCH_ERROR_RAD,
    )


def _samples_of_view(network: DepthNetwork, view: DepthView, shown: ViewGeometry) -> Samples:
    true_m, camera = view.depth_m.astype(np.float32), view.geometry.camera(len(view.depth_m))
    true = reference_depth(camera, view.geometry.pose(), 0.0)
    reference = reference_depth(camera, shown.pose(), 0.0)
    estimate = network.estimate(view.rgb, camera, shown.pose(), 0.0)
    above_m = true.height_m + true_m * (camera.rays() @ view.geometry.pose()[2, :3].astype(np.float32))
    there = ((true_m > 0.0) & (true_m <= BANDS_M[-1][1]))[::_STEP, ::_STEP]

    def sampled(array: NDArray[T]) -> NDArray[T]:
        return array[::_STEP, ::_STEP][there]

    return Samples(
        sampled(true_m),
        sampled(estimate.depth_m),
        sampled(reference.depth_m),
        sampled(estimate.sigma_log),
        sampled(floor_mask(true_m, true.depth_m, true.floor, true.height_m)),
        sampled(above_m > _HIGHER_M),
        sampled(reference.floor),
    )


def measured(
    all_views: Samples, not_fitted: Samples, n_views: int, bands_m: Sequence[tuple[float, float]] = BANDS_M
) -> Measured:
    """The figures of a card. ``not_fitted``: samples of the buildings that the uncertainty wasn't fitted on."""
    kept = not_fitted.known & ~not_fitted.taken_for_floor
    sigmas = not_fitted.error[kept] / not_fitted.sigma_log[kept]
    return Measured(
        n_views,
        [_band(all_views, *band) for band in bands_m],
        _floor(all_views),
        _rounded(np.mean(sigmas <= 1.0)),
        _rounded(np.mean(sigmas <= 2.0)),
    )


def _rounded(value: float | np.floating) -> float:
    return round(float(value), 4)


def _band(s: Samples, nearest_m: float, farthest_m: float) -> Band:
    inside = (s.true_m > nearest_m) & (s.true_m <= farthest_m)
    known = inside & s.known
    relative = np.abs(s.depth_m[known] / s.true_m[known] - 1.0)
    of_reference = np.abs(s.reference_m[inside] / s.true_m[inside] - 1.0)
    return Band(
        nearest_m,
        farthest_m,
        *_median_and_p90(relative),
        _median_and_p90(relative[~s.is_floor[known]])[0],
        *_median_and_p90(of_reference),
        _median_and_p90(of_reference[~s.is_floor[inside]])[0],
        _rounded(1.0 - known.sum() / max(1, inside.sum())),
    )


def _median_and_p90(errors: NDArray[np.float32]) -> tuple[float, float]:
    return _rounded(np.quantile(errors, 0.5)), _rounded(np.quantile(errors, 0.9))


def _floor(s: Samples) -> Floor:
    taken, other = s.taken_for_floor, s.over_floor & ~s.is_floor
    return Floor(
        _rounded(taken[s.is_floor & s.over_floor].mean()),
        _rounded(s.is_floor[taken].sum() / max(1, taken.sum())),
        _rounded(taken[other].mean()),
        _rounded(taken[other & s.higher].mean()),
    )


def ms_per_view(network: Path, view: DepthView, n: int = 20) -> float:
    """Milliseconds of one view on one thread: the fastest of ``n``, since other programs may be running."""
    opened = DepthNetwork(network, Runtime(device="cpu", threads=1))
    camera, pose, times = view.geometry.camera(len(view.depth_m)), view.geometry.pose(), []
    for _ in range(n):
        begun = time.perf_counter()
        opened.estimate(view.rgb, camera, pose, 0.0)
        times.append(time.perf_counter() - begun)
    return round(1e3 * min(times), 1)


def table(name: str, m: Measured) -> str:
    """The figures in Markdown."""
    lines = [
        f"{m.views} views, {name} calibration:",
        "",
        "| true depth | median error | off the floor | 90 % below | empty room | off the floor | 90 % below | unknown |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for b in m.bands:
        network = b.median, b.median_off_floor, b.p90
        reference = b.reference_median, b.reference_median_off_floor, b.reference_p90
        cells = " | ".join(f"{100 * error:.1f} %" for error in (*network, *reference, b.unknown))
        lines.append(f"| {b.nearest_m:.0f} to {b.farthest_m:.0f} m | {cells} |")
    f = m.floor
    return "\n".join(
        [
            *lines,
            "",
            f"Floor found: {100 * f.recall:.1f} %; floor among what is taken for it: {100 * f.precision:.1f} %. Taken for floor "
            f"of the rest: {100 * f.false_share:.1f} %, of what is higher than 10 cm: {100 * f.false_share_above_10_cm:.1f} %.",
            f"Errors within one sigma: {100 * m.within_1_sigma:.0f} %, within two: {100 * m.within_2_sigma:.0f} %.",
        ]
    )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.depth.evaluate", description=__doc__.partition("\n")[0])
    parser.add_argument("--network", type=Path, required=True)
    parser.add_argument("--views", type=Path, required=True)
    parser.add_argument("--card", action="store_true", help="add the figures to the card beside the network")
    args = parser.parse_args(argv)
    packs = read_packs(args.views)
    n_views = sum(len(pack.views) for pack in packs)
    found = {}
    for name in ("exact", "imprecise"):
        halves = [samples_of(args.network, packs[k::2], imprecise=name == "imprecise") for k in (0, 1)]
        found[name] = measured(joined(halves), halves[1], n_views)
        print(table(name, found[name]) + "\n")
    ms = ms_per_view(args.network, packs[0].view(0))
    print(f"{ms} ms of one core per view of {packs[0].side_px} x {packs[0].side_px} pixels")
    if args.card:
        save_card(args.network, msgspec.structs.replace(card_of(args.network), ms=ms, measured=found))


if __name__ == "__main__":
    main()
