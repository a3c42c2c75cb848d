"""Pieces far from all walls are named and left out."""

from __future__ import annotations

import pytest

from surveilnav.simulator.plans.homes import build_home
from surveilnav.simulator.plans.outliers import without_outliers
from surveilnav.simulator.plans.sweethome import read_home
from surveilnav.simulator.world.navigation import NavigationMap

ROOM = "<room><point x='0' y='0'/><point x='600' y='0'/><point x='600' y='400'/><point x='0' y='400'/></room>"
WALL = "<wall id='w' xStart='0' yStart='0' xEnd='600' yEnd='0' thickness='10'/>"


def piece(name: str, x_m: float, y_m: float) -> str:
    size = "width='50' depth='50' height='50'"
    return f"<pieceOfFurniture name='{name}' x='{100 * x_m}' y='{-100 * y_m}' {size}/>"


def plan(body: str):
    return read_home(f"<home version='7000'>{body}</home>".encode(), "test")


@pytest.mark.parametrize("shell", [ROOM, WALL])
@pytest.mark.parametrize(
    ("x_m", "y_m", "away"), [(9000.0, 0.0, "8,994"), (3.0, 200.0, "200"), (-300.0, 400.0, "500"), (107.0, 0.0, "101")]
)
def test_a_piece_far_from_the_walls_is_left_out_and_named(shell, x_m, y_m, away) -> None:
    home, notes = without_outliers(plan(shell + piece("Bed", 1, -1) + piece("Tree", x_m, y_m)))
    assert [p.name for p in home.pieces] == ["Bed"]
    assert notes == [f"too far away, left out: 'Tree' at ({x_m:.0f}, {y_m:.0f}) m, {away} m from the walls"]


def test_a_garden_stays_and_a_plan_without_walls_too() -> None:
    garden = plan(WALL + piece("Tree", 105, 0) + piece("Shed", -50, -60))
    assert without_outliers(garden) == (garden, [])
    loose = plan(piece("Bed", 0, 0) + piece("Tree", 9000, 0))
    assert without_outliers(loose) == (loose, [])


def test_the_farthest_come_first_and_not_all_are_named() -> None:
    trees = "".join(piece(f"t{n}", 1000.0 + 100 * n, 0) for n in range(12))
    _, (note,) = without_outliers(plan(WALL + trees))
    assert note.index("'t11'") < note.index("'t10'") < note.index("'t4'")
    assert "'t3'" not in note
    assert note.endswith("; and 4 more")


def test_a_building_with_a_piece_nine_kilometres_away_can_be_walked() -> None:
    home = plan(ROOM + WALL + piece("Plant", 9000, 1))
    scene = build_home(home, "far", 0, None, None, "test")
    assert any("'Plant' at (9000, 1) m" in note for note in scene.notes)
    assert NavigationMap.build(scene).floors["0"].free.any()
