"""Training views of a building made in code: what they show, how they are packed and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from training.detector import classes
from training.detector.pack import Pack, read_pack, read_packs, write_pack
from training.detector.views import DEPTH_RANGE_M, MIN_AREA_PX, TrainingView, ViewSource, objects_in

NAMES = classes.load()


@pytest.fixture(scope="module")
def source(home_cache: Path) -> ViewSource:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        scene = open_building("parametric_flat", seed=1)
        return ViewSource(scene, NavigationMap.load_or_build(scene, home_cache), "flat", NAMES)


@pytest.fixture(scope="module")
def views(source: ViewSource) -> list[TrainingView]:
    return [*source.views("robot", 6, seed=3), *source.views("camera", 4, seed=3)]


@pytest.fixture(scope="module")
def pack(views: list[TrainingView], tmp_path_factory: pytest.TempPathFactory) -> Pack:
    path = tmp_path_factory.mktemp("packs") / "flat.views"
    write_pack(path, "flat", views, NAMES.names, NAMES.rooms, quality=90)
    read = read_pack(path)
    assert read is not None
    return read


def test_every_object_is_where_its_ids_are(views: list[TrainingView]) -> None:
    assert sum(len(view.labels) for view in views) > 10
    for view in views:
        assert view.ids.max() == len(view.labels) == len(view.boxes) == len(view.areas)
        for number, (box, area) in enumerate(zip(view.boxes, view.areas, strict=True), start=1):
            rows, columns = np.nonzero(view.ids == number)
            assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            assert area == len(rows) >= MIN_AREA_PX
        assert view.near[view.labels].all()


def test_views_are_of_their_kinds_sizes_and_differ(views: list[TrainingView]) -> None:
    assert {(view.kind, view.rgb.shape) for view in views} == {("robot", (240, 320, 3)), ("camera", (416, 416, 3))}
    assert len({view.rgb.tobytes() for view in views}) == len(views)
    assert any(view.room >= 0 for view in views)


def test_the_same_seed_gives_the_same_views(views: list[TrainingView], source: ViewSource) -> None:
    again, other = (next(iter(source.views("robot", 1, seed=seed))) for seed in (3, 4))
    assert (again.rgb == views[0].rgb).all()
    assert (again.ids == views[0].ids).all()
    assert (other.rgb != views[0].rgb).any()


def test_a_pack_gives_back_what_was_packed(views: list[TrainingView], pack: Pack) -> None:
    assert len(pack.views) == len(views)
    for i, view in enumerate(views):
        read = pack.view(i)
        assert (read.kind, read.light, read.room) == (view.kind, view.light, view.room)
        for name in ("ids", "boxes", "labels", "areas", "near"):
            assert (getattr(read, name) == getattr(view, name)).all(), name
        assert np.abs(read.rgb.astype(int) - view.rgb).mean() < 6  # lossy
        np.testing.assert_allclose(read.depth_m, view.depth_m, rtol=0.01)


def test_depth_is_as_a_sensor_gives_it(views: list[TrainingView]) -> None:
    for view in views:
        near, far = DEPTH_RANGE_M[view.kind]
        known = view.depth_m[view.depth_m > 0]
        assert view.depth_m.shape == view.ids.shape
        assert near <= known.min()
        assert known.max() <= far
        assert len(np.unique(known)) > 20  # noisy


def test_a_damaged_pack_is_none_and_goes(views: list[TrainingView], tmp_path: Path) -> None:
    path = tmp_path / "a.views"
    write_pack(path, "a", views[:1], NAMES.names, NAMES.rooms)
    path.write_bytes(path.read_bytes()[:-3])
    assert read_pack(path) is None
    assert not path.exists()


def test_packs_of_other_classes_are_refused(views: list[TrainingView], tmp_path: Path) -> None:
    with pytest.raises(PerceptionError, match="make_views"):
        read_packs(tmp_path, NAMES.names)
    write_pack(tmp_path / "a.views", "a", views[:1], NAMES.names, NAMES.rooms)
    assert len(read_packs(tmp_path, NAMES.names)) == 1
    with pytest.raises(PerceptionError, match="other classes"):
        read_packs(tmp_path, NAMES.names[::-1])


def test_what_shows_too_little_or_has_no_class_is_no_object() -> None:
    ids = np.zeros((40, 60), np.uint16)
    ids[2:12, 3:23] = 1  # a class
    ids[20:30, 3:23] = 2  # none
    ids[2:4, 30:50] = 3  # thin
    ids[20:34, 30:50] = 4
    small, boxes, labels, areas = objects_in(ids, np.array([-1, 7, -1, 5, 2]))
    assert labels.tolist() == [2, 7]  # the largest first
    assert areas.tolist() == [280, 200]
    assert boxes.tolist() == [[30, 20, 50, 34], [3, 2, 23, 12]]
    assert (small == np.where(ids == 4, 1, np.where(ids == 1, 2, 0))).all()
