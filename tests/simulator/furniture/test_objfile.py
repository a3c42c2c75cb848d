from __future__ import annotations

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.furniture import objfile
from surveilnav.simulator.furniture.objfile import EmptyModelError, read_mtl, read_obj

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def test_indices_may_be_negative_and_parts_left_out() -> None:
    model = read_obj(TRIANGLE + b"vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nf -3/-3/-1 -2/-2/-1 -1/-1\nf 1//1 2//1 3\n")
    np.testing.assert_array_equal(model.triangles, [[0, 1, 2], [0, 1, 2]])
    np.testing.assert_array_equal(model.uvs[0], [[0, 0], [1, 0], [0, 1]])
    np.testing.assert_array_equal(model.uvs[1], np.zeros((3, 2)))


def test_names_may_have_spaces_and_lines_may_continue() -> None:
    model = read_obj(TRIANGLE + b"mtllib my lib.mtl\ng two words\nusemtl light  wood\nf 1 2 \\\n 3\n")
    assert model.libraries == ("my lib.mtl",)
    assert model.group_names[model.group[0]] == "two words"
    assert model.material_names[model.material[0]] == "light  wood"


@pytest.mark.parametrize("start", range(8))
def test_a_concave_face_keeps_its_opening_wherever_it_starts(start: int) -> None:
    corners = [(0, 0), (0.1, 0), (0.1, 1.9), (0.9, 1.9), (0.9, 0), (1, 0), (1, 2), (0, 2)]
    corners = corners[start:] + corners[:start]
    lines = [f"v {x} 0 {z}" for x, z in corners] + ["f 1 2 3 4 5 6 7 8"]
    model = read_obj("\n".join(lines).encode())
    p = model.vertices[model.triangles].astype(float)
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(2 - 0.8 * 1.9, rel=1e-4)


def test_a_concave_quadrilateral_is_cut_along_the_right_diagonal() -> None:
    model = read_obj(b"v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 2 3 4 1\n")
    p = model.vertices[model.triangles].astype(float)
    assert np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2 == pytest.approx(4.0)


def test_unused_vertices_are_left_out() -> None:
    assert len(read_obj(b"v 99 99 99\n" + TRIANGLE + b"f 2 3 4\n").vertices) == 3


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"v 0 0\nf 1 1 1\n", "three coordinates"),
        (b"v 0 0 zero\nf 1 1 1\n", "numbers"),
        (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        (b"v 0 0 1e300\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        (TRIANGLE + b"f 1 2 9\n", "isn't there"),
        (TRIANGLE + b"f -1 -2 -9\n", "isn't there"),
        (TRIANGLE + b"f a b c\n", "indices like"),
        (TRIANGLE + b"f" + b" 1" * 600 + b"\n", "at most"),
    ],
)
def test_what_is_wrong_is_named(data: bytes, says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        read_obj(data)


def test_nothing_to_draw_is_an_error_of_its_own() -> None:
    with pytest.raises(EmptyModelError):
        read_obj(b"# a light source\n")


def test_bombs_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objfile, "MAX_VERTICES", 10)
    with pytest.raises(BuildingError, match="more than 10 vertices"):
        read_obj(b"v 0 0 0\n" * 11)
    monkeypatch.setattr(objfile, "MAX_TRIANGLES", 10)
    with pytest.raises(BuildingError, match="more than 10 triangles"):
        read_obj(TRIANGLE + b"f 1 2 3\n" * 11)


def test_beyond_the_budget_a_fan_must_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objfile, "EAR_CLIP_BUDGET", 0)
    lines = [f"v {x} {y} 0" for x, y in ((0, 0), (1, 0), (2, 1), (1, 2), (0, 1))] + ["f 1 2 3 4 5"]
    assert len(read_obj("\n".join(lines).encode()).triangles) == 3


def test_sloppy_mtl() -> None:
    found = read_mtl(
        b"newmtl Light Wood\nKD 0.5 0.25 7\nD 0.5\nns 2000\nMap_Kd -s 1 1 1 my wood.jpg\n"
        b"newmtl broken\nKd one two three\nd nan\n\nnewmtl tab\n\tKd\t1 0 0\n"
    )
    wood = found["Light Wood"]
    assert (wood.color, wood.alpha, wood.shininess) == ((0.5, 0.25, 1.0), 0.5, 128.0)
    assert wood.texture.endswith("my wood.jpg")
    assert (found["broken"].color, found["broken"].alpha) == (None, 1.0)
    assert found["tab"].color == (1.0, 0.0, 0.0)
