"""The parts of what a search loses: never negative, together all of it, and what a slow count of metres says."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surveilnav.benchmark.explain.loss import Loss, loss_of, losses
from surveilnav.benchmark.play.approach import NEAR_M, approach_of
from surveilnav.benchmark.runner.row import record_of_row, row_of
from surveilnav.simulator.world.goals import SUCCESS_M
from tests.benchmark.runner.test_records import RECORD


def trajectory(rng, *, success):
    """A random search: the path so far, and the shortest path that is left.

    It changes by no more than was driven, but for the grid of the shortest paths. Every third search goes about straight on.
    """
    n = int(rng.integers(1, 60))
    driven = np.where(rng.random(n) < 0.4, 0.0, 0.25)  # turns drive nothing
    left, straight = [float(rng.uniform(0.2, 12.0))], rng.random() < 0.3
    for step in driven:
        change = rng.uniform(-1.03, -0.97) if straight else rng.uniform(-1.0, 0.9)
        left.append(max(0.0, left[-1] + step * float(change)))
    if success:  # straight on to a viewpoint
        while left[-1] > SUCCESS_M:
            left.append(max(0.0, left[-1] - 0.25))
            driven = np.append(driven, 0.25)
    return np.concatenate([[0.0], np.cumsum(driven)]).tolist(), left


def record_of(path_m, left_m, *, success):
    shortest_m, longest_m = left_m[0], max(left_m[0], path_m[-1])
    return msgspec.structs.replace(
        RECORD,
        success=success,
        spl=shortest_m / longest_m if success else 0.0,
        path_m=path_m[-1],
        shortest_path_m=shortest_m,
        reason="" if success else "not_seen",
        approach=approach_of(path_m, left_m),
    )


def metre_by_metre(path_m, left_m, *, success):
    """The loss, slowly: each action's metres beyond what it brought nearer, on the leg that the action belongs to."""
    near = [left <= NEAR_M for left in left_m]
    if not success:
        return Loss(failed_near=1.0) if any(near) else Loss(never_near=1.0)
    too_far_m = {"before": 0.0, "left_again": 0.0, "last_approach": 0.0}
    for i in range(1, len(path_m)):
        wasted = (path_m[i] - path_m[i - 1]) - (left_m[i - 1] - left_m[i])
        if not any(near[:i]):
            too_far_m["before"] += wasted
        elif not all(near[i - 1 :]):
            too_far_m["left_again"] += wasted
        else:
            too_far_m["last_approach"] += wasted
    too_far_m["last_approach"] -= left_m[-1]  # it stopped that much short of the viewpoint
    driven_m = {leg: max(0.0, metres) for leg, metres in too_far_m.items()}
    missing = 1.0 - left_m[0] / max(left_m[0], path_m[-1])
    whole = sum(driven_m.values())
    return Loss(**{leg: missing * metres / whole if whole else 0.0 for leg, metres in driven_m.items()})


@pytest.mark.parametrize("success", [True, False])
def test_parts_are_never_negative_and_add_up_to_what_is_missing(success):
    rng = np.random.default_rng(0)
    seen = np.zeros(len(Loss._fields), bool)
    for _ in range(2000):
        path_m, left_m = trajectory(rng, success=success)
        record = record_of(path_m, left_m, success=success)
        loss = np.array(loss_of(record))
        assert (loss >= 0.0).all()
        assert loss.sum() == pytest.approx(1.0 - record.spl, abs=1e-12)
        assert loss == pytest.approx(np.array(metre_by_metre(path_m, left_m, success=success)), abs=1e-9)
        kept = np.array(loss_of(record_of_row(row_of(record))))
        assert kept.sum() == pytest.approx(1.0 - record.spl, abs=1e-6)  # rows are rounded
        assert kept == pytest.approx(loss, abs=2e-2)
        seen |= loss > 0.05
    expected = {True: {"before", "left_again", "last_approach"}, False: {"never_near", "failed_near"}}[success]
    assert {name for name, there in zip(Loss._fields, seen, strict=True) if there} == expected


def test_what_is_lost_on_a_leg_is_what_was_driven_too_far_there_over_the_path():
    """6 m to a goal, and 17 m driven."""
    path_m, left_m = [0.0, 2.0, 4.0, 8.0, 12.0, 14.0, 15.0, 17.0], [6.0, 6.0, 4.0, 5.0, 2.0, 2.0, 2.0, 0.0]
    record = record_of(path_m, left_m, success=True)
    assert record.spl == pytest.approx(6.0 / 17.0)
    # near for the first and the last time after 12 m with 2 m left: 12 - 4 too far before it, 5 - 2 after it
    assert loss_of(record) == pytest.approx(Loss(before=8.0 / 17.0, last_approach=3.0 / 17.0))
    left_m[2] = 2.5  # near after 4 m
    record = record_of(path_m, left_m, success=True)
    assert loss_of(record) == pytest.approx(Loss(before=0.5 / 17.0, left_again=7.5 / 17.0, last_approach=3.0 / 17.0))


def test_a_search_that_drove_no_metre_too_far_loses_nothing():
    straight = record_of([0.0, 2.0, 4.95], [5.0, 3.0, 0.05], success=True)
    assert straight.spl == 1.0
    assert loss_of(straight) == Loss()


def test_losses_are_points_in_columns():
    far = record_of([0.0, 1.0], [9.0, 8.0], success=False)
    near = record_of([0.0, 1.0], [3.0, 2.0], success=False)
    assert losses([far, near]).tolist() == [[100.0, 0.0, 0.0, 0.0, 0.0], [0.0, 100.0, 0.0, 0.0, 0.0]]
    assert losses([]).shape == (0, 5)


def test_a_record_that_cant_be_explained_is_refused():
    with pytest.raises(ValueError, match="doesn't say how near"):
        loss_of(msgspec.structs.replace(RECORD, approach=None))
    with pytest.raises(ValueError, match="wasn't near a goal"):
        loss_of(msgspec.structs.replace(RECORD, approach=approach_of([0.0], [4.0])))
