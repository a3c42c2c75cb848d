"""Floors and stairs found in plain geometry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes.buildings import MeshPart, building_of
from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Material, Scene

GREY = Material("grey", (0.5, 0.5, 0.5))
Corner = tuple[float, float, float]


def boxes(*corners: tuple[Corner, Corner]) -> Mesh:
    builder = MeshBuilder()
    for low, high in corners:
        builder.box(low, high, GREY)
    return builder.mesh()


def shell(width: float, depth: float, z: float, height: float = 2.6) -> Mesh:
    """A floor slab and four walls, no ceiling."""
    w, d, top = width, depth, z + height
    return boxes(
        ((0, 0, z - 0.2), (w, d, z)),
        ((0, 0, z), (w, 0.1, top)),
        ((0, d - 0.1, z), (w, d, top)),
        ((0, 0, z), (0.1, d, top)),
        ((w - 0.1, 0, z), (w, d, top)),
    )


def build(*meshes: Mesh) -> Scene:
    return building_of([MeshPart(f"part {i}", "", (mesh,)) for i, mesh in enumerate(meshes)], "test", "test")


def levels(scene: Scene) -> list[float]:
    return [f.z_m for f in scene.floors]


def flight(x: float, y: float, rise: float, *, steps: int = 12, tread: float = 0.25, width: float = 1.0) -> Mesh:
    """Solid steps up along +x from z = 0."""
    return boxes(
        *(((x + i * tread, y, 0.0), (x + (i + 1) * tread, y + width, rise * (i + 1) / steps)) for i in range(steps))
    )


def two_floors(hole: bool = True) -> list[Mesh]:
    """8 x 6 m twice, 2.6 m apart; a flight along the front wall below a hole in the upper floor."""
    upper = boxes(((0, 1.6, 2.4), (8, 6, 2.6)), ((5, 0, 2.4), (8, 1.6, 2.6)))
    if not hole:
        upper = boxes(((0, 0, 2.4), (8, 6, 2.6)))
    roof = boxes(((0, 0, 5.2), (8, 6, 5.4)))
    return [shell(8, 6, 0.0), upper, roof, flight(2.0, 0.3, 2.6)]


def test_one_floor_and_its_furniture() -> None:
    table = boxes(((1, 1, 0.7), (4, 3, 0.75)))  # larger than 4 m2
    roof = boxes(((0, 0, 2.6), (8, 6, 2.8)))
    scene = build(shell(8, 6, 0.0), roof, table)
    assert levels(scene) == [0.0]
    assert scene.floors[0].height_m == pytest.approx(2.6, abs=0.01)
    assert any("6 m2 at 0.75 m isn't a floor" in note or "at 0.75 m" in note for note in scene.notes)


def test_a_building_without_a_roof_has_its_floor() -> None:
    assert levels(build(shell(8, 6, 0.3))) == [0.3]


def test_roofs_and_gardens_on_a_slope_are_no_floors() -> None:
    roof = boxes(((0, 0, 2.6), (8, 6, 2.8)))
    garden = boxes(((-20, 0, -0.4), (0, 6, -0.2)))
    tilt = np.eye(4)
    tilt[2, 0] = 0.3
    assert levels(build(shell(8, 6, 0.0), roof, garden.moved(tilt))) == [0.0]


def test_a_wide_ramp_is_a_way_and_no_floor() -> None:
    halls = boxes(((0, 0, -0.2), (8, 6, 0)), ((20, 0, -0.2), (28, 6, 2.4)), ((0, 0, 6), (28, 6, 6.2)))
    slope = np.eye(4)
    slope[2, 0] = 0.2
    ramp = boxes(((0, 0, -0.2), (12, 6, 0))).moved(slope)
    ramp.vertices[:, 0] += 8.0
    scene = build(halls, ramp)
    assert levels(scene) == [0.0, 2.4]
    (stair,) = scene.stairs
    assert stair.length_m == pytest.approx(np.hypot(12.0, 2.4), rel=0.1)


def test_stairs_join_floors() -> None:
    scene = build(*two_floors())
    assert levels(scene) == [0.0, 2.6]
    (stair,) = scene.stairs
    assert (stair.lower_floor, stair.upper_floor) == ("0", "1")
    # On and off where a robot has room, beside the first and the last step if that is shorter.
    assert np.hypot(stair.lower_m[0] - 2.1, stair.lower_m[1] - 0.8) < 0.8
    assert np.hypot(stair.upper_m[0] - 4.9, stair.upper_m[1] - 0.8) < 0.8
    assert stair.length_m == pytest.approx(np.hypot(3.0, 2.6), rel=0.15)
    navigation = NavigationMap.build(scene)
    assert len(navigation.transits) == 1
    assert all(area.any() for area in navigation.robot_area.values())
    assert not scene.notes


@pytest.mark.parametrize(("cells", "joins"), [(7, True), (6, False)])
def test_stairs_begin_where_a_robot_fits_by_the_rule_of_its_body(cells: int, joins: bool) -> None:
    """The only way to the first step is a corridor along the grid, of so many open cells, round a corner."""
    wide = cells * 0.05 + 0.01
    blocks = (
        ((0.1, 0.1), (2.0, 0.59), 5.2),
        ((0.1 + wide, 0.59 + wide), (2.0, 1.6), 5.2),
        ((0.1 + wide, 1.6), (7.9, 4.2), 2.4),
        ((5.0, 0.1), (7.9, 1.6), 2.4),
    )
    # Boxes are hollow: lids one above the other leave no headroom.
    aside = boxes(*(((*low, 0.0), (*high, z)) for low, high, top in blocks for z in np.arange(0.4, top, 0.8)))
    scene = build(*two_floors(), aside)
    assert levels(scene) == [0.0, 2.6]
    assert [NavigationMap.build(scene).is_navigable(stair.lower_m, "0") for stair in scene.stairs] == [True] * joins


@pytest.mark.parametrize(
    "broken",
    [
        lambda m: m[:3],  # no flight
        lambda m: [*m[:3], flight(2.0, 0.3, 2.6, steps=6, tread=0.5)],  # risers of 0.43 m
        lambda m: [*m[:3], flight(2.0, 0.3, 2.6, width=0.25)],  # a plank
        lambda m: two_floors(hole=False),  # into the ceiling
    ],
)
def test_what_nobody_can_climb_is_no_stair(broken: Callable[[list[Mesh]], list[Mesh]]) -> None:
    scene = build(*broken(two_floors()))
    assert levels(scene) == [0.0, 2.6]
    assert scene.stairs == ()
    assert any("no stairs found" in note for note in scene.notes)


def test_a_split_level_counts_if_steps_lead_there() -> None:
    podium = boxes(((4, 0.1, 0), (8, 5.9, 1.0)))
    steps = flight(3.0, 2.0, 1.0, steps=5, tread=0.2, width=1.5)
    roof = boxes(((0, 0, 3.0), (8, 6, 3.1)))
    assert levels(build(shell(8, 6, 0.0, 3.0), roof, podium, steps)) == [0.0, 1.0]
    assert levels(build(shell(8, 6, 0.0, 3.0), roof, podium)) == [0.0]


def test_a_model_inside_out_has_floors_too() -> None:
    scene = build(*two_floors())
    flipped = [Mesh(m.vertices, m.triangles[:, ::-1].copy(), m.uvs, m.material, m.materials) for m in two_floors()]
    assert levels(build(*flipped)) == levels(scene)


def test_things_stand_on_the_floor_below_them() -> None:
    lamp = boxes(((1, 4, 2.2), (1.3, 4.3, 2.4)))
    bed = boxes(((5, 3, 2.6), (7, 5, 3.1)))
    pieces = [MeshPart(f"part {i}", "", (mesh,)) for i, mesh in enumerate(two_floors())]
    scene = building_of([*pieces, MeshPart("Lamp", None, (lamp,)), MeshPart("Bed.002", None, (bed,))], "test", "test")
    assert {i.name: (i.label, i.floor) for i in scene.instances[-2:]} == {"Lamp": ("", "0"), "Bed.002": ("bed", "1")}


def test_nowhere_to_stand_is_refused() -> None:
    with pytest.raises(BuildingError, match="no floor"):
        build(boxes(((0, 0, 0), (1.8, 1.8, 0.4))))
