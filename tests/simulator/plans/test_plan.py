from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.simulator.plans.plan import Opening, Wall, build_wall, wall_outline
from surveilnav.simulator.plans.slabs import build_slab
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Material

PAINT = Material("paint", (1, 1, 1))


def wall(start: tuple[float, float], end: tuple[float, float], **more: object) -> Wall:
    values: dict = {"thickness_m": 0.2, "height_m": 2.5, "end_height_m": 2.5, "z_m": 0.0, "left": PAINT, "right": PAINT}
    return Wall(start, end, **{**values, **more})


def volume(mesh: Mesh) -> float:
    """Of a closed mesh, by the divergence theorem: right only if every face is there and looks outward."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6)


def hit(mesh: Mesh, origin: tuple[float, float, float], direction: tuple[float, float, float]) -> bool:
    """Whether a ray meets the mesh (Möller and Trumbore 1997), slow and plain."""
    o, d = np.array(origin), np.array(direction)
    for t in mesh.triangles:
        a, b, c = mesh.vertices[t].astype(float)
        e1, e2 = b - a, c - a
        p = np.cross(d, e2)
        det = e1 @ p
        if abs(det) < 1e-12:
            continue
        u = (o - a) @ p / det
        v = d @ np.cross(o - a, e1) / det
        if u >= 0 and v >= 0 and u + v <= 1 and e2 @ np.cross(o - a, e1) / det > 0:
            return True
    return False


@given(
    angle=st.floats(0, 2 * math.pi),
    length=st.floats(1, 8),
    thickness=st.floats(0.05, 0.4),
    at=st.floats(0.2, 0.8),
    width=st.floats(0.1, 0.5),
    low=st.floats(0, 1.0),
    tall=st.floats(0.2, 1.4),
)
def test_a_wall_with_an_opening_is_closed_and_lacks_exactly_the_opening(
    angle: float, length: float, thickness: float, at: float, width: float, low: float, tall: float
) -> None:
    d = np.array([math.cos(angle), math.sin(angle)])
    centre, end = d * length * at, d * length
    opening = Opening((centre[0], centre[1]), angle, width * length * 0.3, thickness + 0.1, low, low + tall)
    it = wall((0.0, 0.0), (end[0], end[1]), thickness_m=thickness)
    mesh, _ = build_wall(it, wall_outline([it], 0), [opening])
    assert volume(mesh) == pytest.approx(thickness * (length * 2.5 - opening.width_m * tall), rel=1e-3)


def test_a_ray_passes_the_door_and_not_the_wall() -> None:
    it = wall((0, 0), (4, 0))
    mesh, thresholds = build_wall(it, wall_outline([it], 0), [Opening((1.5, 0.0), math.pi, 0.9, 0.3, 0.0, 2.0)])
    assert not hit(mesh, (1.5, -1, 1.0), (0, 1, 0))
    assert hit(mesh, (1.5, -1, 2.2), (0, 1, 0))
    assert hit(mesh, (2.5, -1, 1.0), (0, 1, 0))
    # The ground in the doorway, as wide as the door and as deep as the wall.
    (quad,) = thresholds
    np.testing.assert_allclose(quad.min(axis=0), (1.05, -0.1), atol=1e-6)
    np.testing.assert_allclose(quad.max(axis=0), (1.95, 0.1), atol=1e-6)


def test_a_window_leaves_no_threshold_and_a_door_across_the_end_cuts_nothing() -> None:
    it = wall((0, 0), (4, 0))
    whole, _ = build_wall(it, wall_outline([it], 0), [])
    _, thresholds = build_wall(it, wall_outline([it], 0), [Opening((2, 0), 0, 1, 0.3, 0.9, 2)])
    assert thresholds == []
    across, _ = build_wall(it, wall_outline([it], 0), [Opening((4.1, 0), math.pi / 2, 1, 0.3, 0, 2)])
    assert volume(across) == pytest.approx(volume(whole))


def test_openings_may_overlap_reach_the_end_and_pierce_the_top() -> None:
    it = wall((0, 0), (4, 0))
    openings = [
        Opening((1.0, 0), 0, 1.0, 0.3, 0.0, 2.0),
        Opening((1.5, 0), 0, 1.0, 0.3, 1.0, 2.2),
        Opening((3.9, 0), 0, 0.6, 0.3, 2.0, 9.0),
    ]
    mesh, _ = build_wall(it, wall_outline([it], 0), openings)
    gone = 1.0 * 2.0 + (1.0 * 1.2 - 0.5 * 1.0) + 0.4 * 0.5
    assert volume(mesh) == pytest.approx(0.2 * (4 * 2.5 - gone), rel=1e-4)


def test_a_sloped_wall_is_a_trapezium() -> None:
    it = wall((0, 0), (4, 0), height_m=1.0, end_height_m=3.0)
    mesh, _ = build_wall(it, wall_outline([it], 0), [])
    assert volume(mesh) == pytest.approx(0.2 * 4 * 2.0, rel=1e-4)
    assert mesh.vertices[:, 2].max() == pytest.approx(3.0)


@pytest.mark.parametrize("reverse_second", [False, True])
def test_joined_walls_are_mitred_whichever_way_they_run(reverse_second: bool) -> None:
    ends = ((4.0, 0.0), (4.0, 3.0))
    second = wall(*(ends[::-1] if reverse_second else ends), **{"at_end" if reverse_second else "at_start": 0})
    walls = [wall((0, 0), (4, 0), at_end=1), second]
    for index in range(2):  # both reach the outer and the inner corner
        outline = wall_outline(walls, index)
        for corner in ((4.1, -0.1), (3.9, 0.1)):
            assert np.linalg.norm(outline - np.array(corner), axis=1).min() < 1e-6
    volumes = [volume(build_wall(w, wall_outline(walls, i), [])[0]) for i, w in enumerate(walls)]
    # Together they are the corner's outline, nothing twice and nothing missing.
    assert sum(volumes) == pytest.approx(2.5 * (4.1 * 0.2 + 2.9 * 0.2), rel=1e-3)


def test_walls_in_line_or_without_length_are_no_trouble() -> None:
    walls = [
        wall((0, 0), (2, 0), at_end=1),
        wall((2, 0), (4, 0), at_start=0, at_end=2),
        wall((4, 0), (4, 0), at_start=1),
    ]
    meshes = [build_wall(w, wall_outline(walls, i), [])[0] for i, w in enumerate(walls)]
    assert [volume(m) for m in meshes[:2]] == pytest.approx([1.0, 1.0], rel=1e-3)
    assert len(meshes[2].triangles) == 0
    assert all(np.isfinite(m.vertices).all() for m in meshes)


def test_a_slab_has_its_hole_and_looks_up() -> None:
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], dtype=float)
    for outline in (square, square[::-1]):
        mesh = build_slab(outline, 1.0, PAINT, [square / 4 + 1], up=True)
        corners = mesh.vertices[mesh.triangles].astype(float)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (normal[:, 2] > 0).all()
        assert normal[:, 2].sum() / 2 == pytest.approx(15.0)
