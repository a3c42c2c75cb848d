"""Training: batches, learning eight views by heart, going on after a kill."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import torch

from surveilnav.geometry import Pinhole
from surveilnav.perception.boxes import Boxes, merge_overlapping, overlaps
from surveilnav.perception.detectors.depth_channels import N_CHANNELS
from training.detector import classes
from training.detector.data import CANVAS, SMALL_CANVAS, Views, _framed, collate, plain, repeat_factors, varied
from training.detector.export import write_weights
from training.detector.network import Shape, boxes_of, places
from training.detector.pack import Pack
from training.detector.train import Plan, Training, steps_of
from training.detector.views import TrainingView

NAMES = classes.load()
TINY = Shape(stem=8, channels=(16, 24, 32, 32), blocks=(0, 1, 1, 0), neck=32, head=1, prototypes=4, embedding=16)


def test_varied_views_keep_boxes_and_ids_together(pack: Pack) -> None:
    seen = 0
    for seed in range(30):
        example = varied(pack.view(seed % 8), CANVAS["robot"], np.random.default_rng(seed))
        assert example.rgb.shape == (256, 320, 3)
        assert example.depth.shape == (128, 160, N_CHANNELS)
        for number, box in enumerate(example.boxes, start=1):
            rows, columns = np.nonzero(example.ids == number)
            assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert example.ids.max(initial=0) == len(example.labels)
        seen += len(example.labels)
    assert seen > 30


@pytest.mark.parametrize("seed", range(6))
def test_depth_is_that_of_the_lens_that_the_varied_view_would_have(seed: int) -> None:
    """A wall straight ahead stays one, at its distance, however a view is mirrored, zoomed and cropped."""
    lens, rng = Pinhole.from_hfov(320, 240, 1.38), np.random.default_rng(seed)
    slope = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    depth_m = (2.0 / (lens.rays() @ slope)).astype(np.float32)
    nothing = np.zeros(0, np.int64)
    view = TrainingView(
        "robot",
        "flat",
        1.38,
        np.zeros((240, 320, 3), np.uint8),
        depth_m,
        np.zeros((240, 320), np.uint8),
        np.zeros((0, 4), np.float32),
        nothing,
        nothing,
        np.zeros(len(NAMES.names), bool),
        -1,
    )
    shot = _framed(view, CANVAS["robot"], rng)
    channels = shot.channels()
    normals = channels[..., 4:7][channels[..., 4:7].any(axis=-1)]
    slope[0] *= np.sign(np.median(normals[:, 0])) * np.sign(slope[0])  # mirrored or not
    assert len(normals) > 1000
    assert np.quantile(np.abs(normals - slope).max(axis=1), 0.9) < 0.04  # pixels are repeated where it is zoomed
    points = shot.lens.back_project(shot.depth_m)[shot.depth_m > 0]
    np.testing.assert_allclose(points @ slope, 2.0, atol=0.03)


def test_a_step_has_its_batch(pack: Pack) -> None:
    views = Views([pack], seed=2)
    one, again, other = views.batch(5, 4), views.batch(5, 4), views.batch(6, 4)
    assert torch.equal(one.pictures, again.pictures)
    assert torch.equal(one.targets.boxes, again.targets.boxes)
    assert not torch.equal(one.pictures, other.pictures)
    ahead = list(views.batches(5, 7, 4))
    assert torch.equal(ahead[0].pictures, one.pictures)
    assert torch.equal(ahead[1].ids, other.ids)


def test_training_begins_with_small_pictures(pack: Pack) -> None:
    views = Views([pack], seed=1, small_steps=2)
    sides = [views.batch(step, 2).pictures.shape[2:] for step in range(4)]
    assert all(max(side) == max(SMALL_CANVAS["robot"]) for side in sides[:2])
    assert all(max(side) == 320 for side in sides[2:])


def test_rare_classes_are_drawn_more_often() -> None:
    shown = [[0], [0, 0, 1], [0], [0], [0, 2], *[[0]] * 95]
    assert repeat_factors(shown) == {0: 1.0, 1: 5.0, 2: 5.0}  # sqrt(.5 / .01) is more than 5
    assert repeat_factors([[0], [0], [0], [1]])[1] == pytest.approx(np.sqrt(0.5 / 0.25))


def test_a_view_with_a_rare_class_comes_more_often(pack: Pack) -> None:
    views = Views([pack])
    weights = views._weights["robot"]
    shares = np.diff(weights, prepend=0.0)
    repeats = repeat_factors([view.labels for view in pack.views])
    rows = [pack.views[i] for _, i in views._rows["robot"]]
    assert shares == pytest.approx([max([1.0, *(repeats[label] for label in row.labels)]) for row in rows])


@pytest.mark.slow
def test_processes_make_the_same_batches(pack: Pack) -> None:
    views = Views([pack], seed=2)
    made = list(views.batches(3, 6, 2, workers=2))
    assert all(torch.equal(views.batch(3 + i, 2).pictures, batch.pictures) for i, batch in enumerate(made))


def test_after_a_kill_it_ends_with_the_same_weights(pack: Pack, tmp_path: Path) -> None:
    views, plan = Views([pack]), Plan(steps=4, batch=2, log_every=1)
    whole = Training(plan, views, tmp_path / "whole", TINY)
    whole.run()
    killed = Training(plan, views, tmp_path / "parts", TINY)
    killed.run(until=2)
    kept = killed.checkpoint.read_bytes()
    killed.run(until=3)
    killed.checkpoint.write_bytes(kept)  # as if it had been killed before step 3 was saved
    resumed = Training(plan, views, tmp_path / "parts", TINY)
    assert resumed.step == 2
    resumed.run()
    for name in ("network", "mean"):
        for a, b in zip(getattr(whole, name).parameters(), getattr(resumed, name).parameters(), strict=True):
            assert torch.equal(a, b)
    rows = list(csv.DictReader((tmp_path / "parts" / "curve.csv").open(encoding="utf-8")))
    assert [row["step"] for row in rows] == ["1", "2", "3", "4"]


def test_a_run_begins_with_the_weights_of_another(pack: Pack, tmp_path: Path) -> None:
    views, plan = Views([pack]), Plan(steps=2, batch=2)
    first = Training(plan, views, tmp_path / "first", TINY)
    first.run()
    other = Training(plan, views, tmp_path / "other", TINY, start=first.checkpoint)
    assert other.step == 0
    for a, b in zip(first.mean.parameters(), other.network.parameters(), strict=True):
        assert torch.equal(a, b)
    write_weights(tmp_path / "halved.pt", torch.load(first.checkpoint, weights_only=True))
    assert (tmp_path / "halved.pt").stat().st_size < first.checkpoint.stat().st_size / 4
    halved = Training(plan, views, tmp_path / "third", TINY, start=tmp_path / "halved.pt")
    for a, b in zip(first.mean.parameters(), halved.network.parameters(), strict=True):
        torch.testing.assert_close(a, b, atol=1e-3, rtol=1e-3)
    halved.run(until=1)
    again = Training(plan, views, tmp_path / "third", TINY)
    assert steps_of(torch.load(again.checkpoint, weights_only=True)) == 3, "those of the first run count, too"


@pytest.mark.slow
def test_it_learns_eight_views_by_heart(pack: Pack, tmp_path: Path) -> None:
    training = Training(Plan(steps=120, rate=4e-3, warm_up=10), Views([pack]), tmp_path, TINY)
    batch = collate([plain(pack.view(i), CANVAS["robot"]) for i in range(8)])
    course = [training.one_step(batch)["loss"] for _ in range(120)]
    assert np.mean(course[-5:]) < 0.5 * np.mean(course[:5])
    with torch.no_grad():
        output = training.mean(batch.pictures.float() / 255.0, batch.depth)
    found = things = 0
    points, _ = places(256, 320)
    for i in range(8):
        xyxy, scores = boxes_of(output.ltrb[i], points).numpy(), output.logits[i].sigmoid().numpy()
        keep = scores.max(axis=1) > 0.2
        boxes = merge_overlapping(Boxes(xyxy[keep], scores[keep], NAMES.names), 0.6)
        true = pack.view(i)
        iou, _ = overlaps(true.boxes, boxes.xyxy)
        right = np.array(boxes.labels)[None, :] == np.array(NAMES.names)[true.labels][:, None]
        found += int(((iou >= 0.5) & right).any(axis=1).sum()) if len(boxes) else 0
        things += len(true.labels)
    assert found >= 0.8 * things
