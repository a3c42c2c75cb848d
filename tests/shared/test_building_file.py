"""building.yaml: what it may say, and that each mistake is named at its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.building_file import load_building
from surveilnav.errors import ConfigError

WHOLE = """\
building: headquarters
cameras: cameras.yaml
robots: {r1: robots/r1.yaml}
floors:
  ground:
    plan: plans/ground.png
    nav2_map: maps/ground.yaml
    T_building_map: {x_m: 12.4, y_m: 3.1, yaw_deg: 91.5}
    keepout:
      server room: [[0, 0], [3, 0], [3, 2.5], [0, 2.5]]
    passages:
      lift_1: {kind: lift, outline_m: [[5, 0], [6, 0], [6, 1]]}
"""


def test_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    read = load_building(tmp_path / "building.yaml", WHOLE)
    assert (read.cameras, read.robots) == (tmp_path / "cameras.yaml", {"r1": tmp_path / "robots/r1.yaml"})
    ground = read.floors["ground"]
    assert (ground.plan, ground.nav2_map) == (tmp_path / "plans/ground.png", tmp_path / "maps/ground.yaml")
    assert ground.keepout == {"server room": [(0, 0), (3, 0), (3, 2.5), (0, 2.5)]}
    assert ground.passages["lift_1"].kind == "lift"


def test_a_name_is_enough(tmp_path: Path) -> None:
    read = load_building(tmp_path / "building.yaml", "building: shed\n")
    assert (read.cameras, read.robots, read.floors) == (tmp_path / "cameras.yaml", {}, {})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("building: headquarters\n", ""), "building: Field required"),
        (("[3, 2.5], ", "[.nan, 2.5], "), "line 10: floors.ground.keepout.server room.2.0: .*finite"),
        (("[3, 2.5], ", "[3, 6e5], "), "line 10: .*at most 100000 metres"),
        (("[[5, 0], [6, 0], [6, 1]]", "[[5, 0], [6, 0]]"), "line 12: .*at least 3"),
        (("    T_building_map: {x_m: 12.4, y_m: 3.1, yaw_deg: 91.5}\n", ""), "line 5: .*needs T_building_map"),
        (("r1: robots", "r/1: robots"), "line 3: robots"),
        (("kind: lift", "kind: stairs"), "'door' or 'lift'"),
        (("cameras: cameras.yaml", "camera: cameras.yaml"), "line 2: camera: Extra inputs"),
    ],
)
def test_a_mistake_is_named_at_its_line(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    assert change[0] in WHOLE
    with pytest.raises(ConfigError, match=says):
        load_building(tmp_path / "building.yaml", WHOLE.replace(*change))


def test_no_file_no_table(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="can't be read"):
        load_building(tmp_path / "building.yaml")
    with pytest.raises(ConfigError, match="begins with `building:`"):
        load_building(tmp_path / "building.yaml", "- 1\n")
