"""Buildings furnished anew for training: what changes, and what must not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.simulator.furniture.parametric import SIZES_M
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.scene import Scene
from training.detector.furniture import DRAWN, drawn_piece
from training.detector.variation import varied_scene


@pytest.fixture(scope="module")
def scene(home_cache: Path) -> Scene:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        return open_building("parametric_flat", seed=1)


def test_everything_keeps_its_name_its_floor_and_about_its_place(scene: Scene) -> None:
    varied = varied_scene(scene, 1)
    assert [(i.name, i.label, i.floor) for i in varied.instances] == [
        (i.name, i.label, i.floor) for i in scene.instances
    ]
    for old, new in zip(scene.instances, varied.instances, strict=True):
        if old.label in ("wall", "floor", "ceiling", "door", "window", "stairs"):
            assert (new.p_min, new.p_max) == (old.p_min, old.p_max)
        apart = np.abs((np.add(new.p_min, new.p_max) - np.add(old.p_min, old.p_max)) / 2)
        assert (apart[:2] < 0.6).all(), f"{old.name} moved by {apart} m"


def test_the_same_seed_gives_the_same_building_and_another_another(scene: Scene) -> None:
    hashes = [varied_scene(scene, seed).content_hash for seed in (1, 1, 2)]
    assert hashes[0] == hashes[1] != hashes[2]
    assert scene.content_hash not in hashes


def test_goals_are_drawn_anew_and_surfaces_painted(scene: Scene) -> None:
    def triangles(s: Scene, label: str) -> list[int]:
        return [int((s.instance_of_triangle == i.id).sum()) for i in s.labelled(label)]

    seeds = [varied_scene(scene, seed) for seed in range(1, 9)]
    for label in {i.label for i in scene.instances} & set(DRAWN):
        assert len({tuple(triangles(s, label)) for s in [*seeds, scene]}) > 1, f"every {label} is the same"
    assert len({s.materials[0].color for s in seeds}) > 2


@pytest.mark.parametrize("kind", DRAWN)
def test_pieces_of_a_kind_stand_on_the_floor_about_as_large_as_they_should(kind: str) -> None:
    rng = np.random.default_rng(5)
    w, d, h = SIZES_M[kind]
    sizes, looks = set(), set()
    for _ in range(40):
        mesh = drawn_piece(kind, (w, d, h), rng)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert np.isfinite(mesh.vertices).all()
        assert -0.01 <= low[2] < 0.5 * h  # a toilet may hang
        assert (high - low < np.array([1.4 * w + 0.1, d + 0.95, max(1.35 * h, 2.1)])).all(), f"{kind} of {high - low} m"
        assert (high - low > 0.3 * np.array([w, min(w, d, 0.1), h])).all(), f"{kind} of {high - low} m"
        sizes.add(len(mesh.triangles))
        looks.add(mesh.vertices.tobytes())
    assert len(sizes) >= 3
    assert len(looks) == 40
