from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.simulator.furniture.catalog import CatalogModel, parse_rotation, read_catalog, stretch
from surveilnav.simulator.furniture.models import Model
from surveilnav.simulator.plans.placing import fitted, kind_of, kinds, placed, seeded
from surveilnav.simulator.plans.sweethome import Piece
from surveilnav.simulator.world.scene import Material


def model(points: np.ndarray) -> Model:
    n = len(points) // 3
    return Model(
        points.astype(np.float32),
        np.arange(3 * n, dtype=np.int32).reshape(-1, 3),
        np.zeros((n, 3, 2), np.float32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        (Material("m", (1, 1, 1)),),
        ("",),
    )


def piece(**more: object) -> Piece:
    values: dict = {
        "name": "thing",
        "level": "",
        "catalog_id": "",
        "model": "",
        "x_m": 0.0,
        "y_m": 0.0,
        "z_m": 0.0,
        "size_m": (1.0, 2.0, 3.0),
        "yaw_rad": 0.0,
    }
    return Piece(**{**values, **more})


#: One marked point on each side of a box in the OBJ's frame: x to the right, y up, z to the front.
RIGHT, UP, FRONT = np.array([4.0, 0, 0]), np.array([0, 2.0, 0]), np.array([0, 0, 1.0])
CROSS = np.array([RIGHT, -RIGHT, UP, -UP, FRONT, -FRONT]) + np.array([7.0, 8, 9])


def ends(p: Piece, z_floor_m: float = 0.0) -> np.ndarray:
    """Where the marks lie in the world: right, left, up, down, front, back."""
    return placed(model(CROSS), p, p.rotation, z_floor_m).vertices


def test_a_piece_fills_its_box_and_looks_towards_minus_y() -> None:
    marks = ends(piece(x_m=10.0, y_m=20.0, z_m=0.5), z_floor_m=2.62)
    middle = np.array([10, 20, 2.62 + 0.5 + 1.5])
    expected = middle + np.array([[0.5, 0, 0], [-0.5, 0, 0], [0, 0, 1.5], [0, 0, -1.5], [0, -1, 0], [0, 1, 0]])
    np.testing.assert_allclose(marks, expected, atol=1e-5)


def test_a_quarter_turn_clockwise_in_the_plan() -> None:
    # Sweet Home 3D: angle = pi/2 turns the front from "down" to "left" on the screen, from -y to -x in the world.
    marks = ends(piece(yaw_rad=-math.pi / 2))
    np.testing.assert_allclose(marks[4], (-1, 0, 1.5), atol=1e-5)
    np.testing.assert_allclose(marks[0], (0, -0.5, 1.5), atol=1e-5)


def test_a_mirrored_piece_swaps_left_and_right_and_keeps_its_outside_outside() -> None:
    plain = placed(model(CROSS), piece(), None, 0.0)
    mirrored = placed(model(CROSS), piece(mirrored=True), None, 0.0)
    assert ends(piece(mirrored=True))[0][0] == pytest.approx(-0.5)

    def turn(mesh: object) -> np.ndarray:
        p = mesh.vertices[mesh.triangles].astype(float)  # type: ignore[attr-defined]
        return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])

    np.testing.assert_allclose(turn(mirrored) * np.array([-1, 1, 1]), turn(plain), atol=1e-5)


def test_the_models_own_rotation_comes_before_the_box() -> None:
    # x -> y, y -> z, z -> x: what was on the right is on top and as far up as the box is high.
    rotation = (0.0, 0, 1, 1, 0, 0, 0, 1, 0)
    np.testing.assert_allclose(ends(piece(rotation=rotation))[0], (0, 0, 3.0), atol=1e-5)


def test_a_tilted_piece_stands_on_its_elevation() -> None:
    for tilt in ({"pitch_rad": 0.6}, {"roll_rad": -0.4}):
        mesh = placed(model(CROSS), piece(z_m=1.0, **tilt), None, 0.0)
        assert mesh.vertices[:, 2].min() == pytest.approx(1.0, abs=1e-5)
    # Pitch about the width's axis by -pitch: the front goes up for a positive pitch (rotX(-pitch), z to the front).
    assert ends(piece(pitch_rad=0.6))[4][2] > ends(piece(pitch_rad=0.6))[5][2]


@given(st.floats(-7, 7), st.floats(0.1, 3), st.floats(0.1, 3), st.floats(0.1, 3))
def test_turning_back_gives_the_box(yaw: float, w: float, d: float, h: float) -> None:
    p = ends(piece(size_m=(w, d, h), yaw_rad=yaw, x_m=1.0, y_m=-2.0)) - np.array([1.0, -2.0, 0])
    c, s = math.cos(-yaw), math.sin(-yaw)
    back = p @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    np.testing.assert_allclose(np.ptp(back, axis=0), (w, d, h), atol=1e-4)


def test_a_flat_model_divides_by_nothing() -> None:
    flat = model(np.array([[0, 0, 0], [1.0, 0, 0], [0, 1, 0]]))
    assert np.isfinite(placed(flat, piece(size_m=(1, 0, 1)), None, 0.0).vertices).all()


def entry(w: float, d: float, h: float) -> CatalogModel:
    return CatalogModel("x", "x", "", "lib", "x.obj", (w, d, h), None)


def test_fits() -> None:
    p = piece(size_m=(2.0, 2.0, 0.5))
    assert fitted(p, entry(1, 1, 1), "box").size_m == (2.0, 2.0, 0.5)
    assert fitted(p, entry(1, 1, 1), "floor").size_m == (2.0, 2.0, pytest.approx(2.0))
    assert fitted(p, entry(1, 1, 1), "height").size_m == pytest.approx((0.5, 0.5, 0.5))
    # At the back: behind a piece that looks to +x (a quarter turn counter-clockwise from -y) is -x.
    turned = fitted(piece(size_m=(2.0, 2.0, 0.9), yaw_rad=math.pi / 2), entry(2, 1, 0.8), "back")
    assert turned.size_m == pytest.approx((2.0, 1.0, 0.8))
    assert (turned.x_m, turned.y_m) == pytest.approx((-0.5, 0.0))


def test_every_kind_names_its_label_and_fit() -> None:
    from surveilnav.perception.vocabulary import COCO

    for kind in kinds().values():
        assert kind.label == "" or kind.label in COCO
        assert kind.fit in ("box", "floor", "height", "back")
        assert kind.models


@pytest.mark.parametrize(
    ("catalog_id", "size", "kind"),
    [
        ("eTeks#bed", (1.4, 1.9, 0.5), "double bed"),
        ("eTeks#plant", (0.16, 0.14, 0.23), "small plant"),
        ("eTeks#plant", (0.58, 0.5, 1.2), "plant"),
        ("eTeks#squareTable", (1.2, 0.8, 0.74), "table"),
        ("eTeks#squareTable", (1.2, 0.8, 0.4), None),
        ("eTeks#cornerSofa", (2.3, 1.7, 0.9), "corner sofa"),
        ("eTeks#kitchenCabinet", (0.6, 0.6, 0.9), None),
        ("Scopia#bed1", (1.7, 2.1, 1.1), None),
    ],
)
def test_kind_of(catalog_id: str, size: tuple[float, float, float], kind: str | None) -> None:
    found = kind_of(catalog_id, size)
    assert (found.name if found else None) == kind


def test_stretch_is_zero_for_the_same_proportions() -> None:
    assert stretch((1, 2, 3), (2, 4, 6)) == pytest.approx(0.0)
    assert stretch((1, 1, 1), (1, 1, 2)) == pytest.approx(math.log(2))


def test_seeded_depends_on_the_text_alone() -> None:
    assert seeded("a").integers(1 << 30) == seeded("a").integers(1 << 30)
    assert seeded("a").integers(1 << 30) != seeded("b").integers(1 << 30)


def test_catalogue_lines() -> None:
    text = (
        b"id#1=A#b\nname#1=Bed\nmodel#1=/a/b.obj\nwidth#1=100\ndepth#1=200\nheight#1=50\n"
        b"modelRotation#1=0 0 -1 0 1 0 1 0 0\nid#2=broken\nname#2=No model\n"
    )
    (only,) = read_catalog(text, "lib")
    assert (only.id, only.path, only.size_m) == ("A#b", "a/b.obj", (1.0, 2.0, 0.5))
    assert only.rotation == (0, 0, -1, 0, 1, 0, 1, 0, 0)


@pytest.mark.parametrize("text", ["", "1 2 3", "1 0 0 0 1 0 0 0 nan", "9 0 0 0 9 0 0 0 9", "a b c d e f g h i"])
def test_no_rotation(text: str) -> None:
    assert parse_rotation(text) is None
