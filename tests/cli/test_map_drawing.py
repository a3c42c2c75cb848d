"""The map in a terminal: which character stands where."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from surveilnav.cli.map_drawing import draw

#: Cells of half a metre; the map's south-western cell lies at (-1, 2).
PLACE = SimpleNamespace(T_world_cell=[[0.5, 0.0, -1.0], [0.0, 0.5, 2.0], [0.0, 0.0, 1.0]], resolution_m=0.5)


def table(rows: list[str], known: dict[str, float]) -> list[list[float]]:
    """Numbers from rows of characters, the northernmost first, as people draw."""
    return [[known.get(c, 0) for c in row] for row in reversed(rows)]


def layers(rows: list[str]) -> dict[str, list[list[float]]]:
    return {
        "explored": table(rows, {".": 1, "?": 1}),
        "frontier": table(rows, {"?": 1}),
        "occupancy": table(rows, {"#": 1}),
    }


def lines(drawing) -> list[str]:
    return [line.plain for line in drawing.lines]


def test_each_character_is_two_cells_high_and_obstacles_win():
    drawing = draw(layers(["####", "#..?", "#..?", "#..?"]), PLACE, [], [], [], width=80)
    assert lines(drawing) == ["####", "#··?"]
    assert (drawing.column_m, drawing.line_m) == (0.5, 1.0)


def test_only_what_is_known_is_drawn_and_no_wider_than_the_terminal():
    empty, wall = " " * 40, " " * 5 + "#" * 30 + " " * 5
    assert lines(draw(layers([empty, empty, wall, wall, empty, empty]), PLACE, [], [], [], width=80)) == ["#" * 30]
    narrow = draw(layers([wall] * 4), PLACE, [], [], [], width=10)
    assert lines(narrow) == ["#" * 10]
    assert narrow.column_m == 1.5


def test_a_map_that_knows_nothing_is_blank():
    assert lines(draw(layers([" " * 4] * 4), PLACE, [], [], [], width=80)) == [" " * 4] * 2


@pytest.mark.parametrize(("yaw_rad", "arrow"), [(0, ">"), (math.pi / 2, "^"), (math.pi, "<"), (-math.pi / 2, "v")])
def test_robots_cameras_and_objects_stand_where_they_are(yaw_rad, arrow):
    rows = ["." * 4] * 4  # x from -1 to 0.5, y from 2 to 3.5
    robots = [SimpleNamespace(position_m=[-1.0, 2.0, 0.0], yaw_rad=yaw_rad)]
    cameras = [SimpleNamespace(position_m=[0.5, 3.5, 2.0]), SimpleNamespace(position_m=[99.0, 99.0, 2.0])]
    objects = [SimpleNamespace(center_m=[0.0, 2.4, 0.5])]
    assert lines(draw(layers(rows), PLACE, robots, cameras, objects, width=80)) == ["···C", f"{arrow}·o·"]


def test_a_turned_map_puts_things_where_its_cells_are():
    turned = SimpleNamespace(T_world_cell=[[0.0, -0.5, 3.0], [0.5, 0.0, 1.0], [0.0, 0.0, 1.0]], resolution_m=0.5)
    cameras = [SimpleNamespace(position_m=[3.0 - 0.5 * 2, 1.0 + 0.5 * 3, 2.0])]  # of row 2, column 3
    assert lines(draw(layers(["." * 4] * 4), turned, [], cameras, [], width=80)) == ["···C", "····"]


def test_values_are_shaded_from_the_lowest_to_the_highest():
    values = [[0.0, 0.4, 1.0, math.nan]] * 2
    drawing = draw(layers(["...."] * 2) | {"value": values}, PLACE, [], [], [], width=80)
    assert lines(drawing) == ["░▒█ "]
    assert "value, low to high" in drawing.legend.plain


def test_what_only_a_map_from_before_has_is_marked_and_in_the_legend():
    rows = ["####", "#.--", "#.--", "#+++"]
    known = layers(rows) | {"occupancy": table(rows, {"#": 1, "+": 3, "-": 4})}
    drawing = draw(known, PLACE, [], [], [], width=80)
    assert lines(drawing) == ["####", "#+++"]
    assert "free by a map from before" in drawing.legend.plain
    assert "before" not in draw(layers(rows), PLACE, [], [], [], width=80).legend.plain


def area(kind, outline_m, state=None):
    return SimpleNamespace(kind=kind, state=state, outline_m=outline_m)


def test_where_no_robot_is_sent_is_marked_and_in_the_legend():
    rows = ["######", "#....#", "#....#", "#....#", "#....#", "######"]  # x from -1 to 1.5, y from 2 to 4.5
    zone = area("keepout", [(-0.6, 2.4), (0.1, 2.4), (0.1, 3.1), (-0.6, 3.1)])
    door = area("door", [(0.9, 3.4), (9e4, 3.4), (9e4, 3.6), (0.9, 3.6)], "closed")
    drawing = draw(layers(rows), PLACE, [], [], [], width=80, areas=[zone, door])
    assert lines(drawing) == ["######", "#xx·x#", "######"]
    assert "x keepout zone" in drawing.legend.plain
    opened = [area("door", door.outline_m, state) for state in ("open", "unknown")]
    drawing = draw(layers(rows), PLACE, [], [], [], width=80, areas=opened)
    assert lines(drawing) == ["######", "#····#", "######"]
    assert "keepout" not in drawing.legend.plain
