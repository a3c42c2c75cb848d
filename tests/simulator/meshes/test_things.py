"""Which parts of a mesh are one thing: by table, then from a file to the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surveilnav.simulator.meshes.things import MeshPart, groups_of, thing_sizes, whole_things
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Material

#: Name, low corner, size [m].
Row = tuple[str, tuple[float, float, float], tuple[float, float, float]]
PAINT = (Material("paint", (1, 1, 1)),)


def box(low: Sequence[float], size: Sequence[float]) -> Mesh:
    vertices = np.array([low, np.add(low, size), np.add(low, (size[0], 0, 0))], dtype=np.float32)
    return Mesh(
        vertices, np.array([[0, 1, 2]], np.int32), np.zeros((1, 3, 2), np.float32), np.zeros(1, np.int32), PAINT
    )


def pieces(parts: Sequence[Row]) -> list[MeshPart]:
    return [MeshPart(name, None, (box(low, size),)) for name, low, size in parts]


def moved(parts: Sequence[Row], x: float, y: float = 0.0, number: int = 0) -> list[Row]:
    """The same parts elsewhere, "Bed_frame" as "Bed_2_frame"."""
    return [
        (name.replace("_", f"_{number}_", 1) if number else name, (low[0] + x, low[1] + y, low[2]), size)
        for name, low, size in parts
    ]


BED: list[Row] = [
    ("Bed_frame", (0, 0, 0), (1.65, 2.05, 0.3)),
    ("Bed_mattress", (0.02, 0.02, 0.3), (1.6, 2.0, 0.25)),
    ("Bed_pillow_1", (0.1, 1.5, 0.55), (0.6, 0.4, 0.12)),
    ("Bed_pillow_2", (0.9, 1.5, 0.55), (0.6, 0.4, 0.12)),
    ("Bed_head", (0, 2.05, 0), (1.65, 0.05, 1.1)),
]
CHAIR: list[Row] = [
    ("Chair_seat", (0, 0, 0.42), (0.45, 0.45, 0.05)),
    ("Chair_back", (0, 0.43, 0.47), (0.45, 0.03, 0.45)),
    *((f"Chair_leg_{i}", (0.4 * (i % 2), 0.4 * (i // 2), 0), (0.04, 0.04, 0.42)) for i in range(4)),
]
WHOLE_CHAIR: list[Row] = [("Chair", (0, 0, 0), (0.45, 0.48, 0.9))]

CASES: dict[str, tuple[list[Row], list[str]]] = {
    "a bed of parts": (BED, ["Bed"]),
    "two beds side by side": (moved(BED, 0, number=1) + moved(BED, 1.65, number=2), ["Bed_1", "Bed_2"]),
    "twin beds pushed together": (
        [("Bed_1", (0, 0, 0), (0.9, 2, 0.5)), ("Bed_2", (0.9, 0, 0), (0.9, 2, 0.5))],
        ["Bed_1", "Bed_2"],
    ),
    "bunk beds": ([("Bed_1", (0, 0, 0), (0.9, 2, 0.5)), ("Bed_2", (0, 0, 0.5), (0.9, 2, 0.5))], ["Bed_1", "Bed_2"]),
    "a mattress as high as its frame": (
        [("Bed_frame", (0, 0, 0), (1.6, 2, 0.3)), ("Bed_top", (0, 0, 0.3), (1.6, 2, 0.3))],
        ["Bed"],
    ),
    "a copy in less detail": (
        [("Bed_lod", (0, 0, 0), (1.6, 2, 0.5)), ("Bed_lod.001", (0, 0, 0), (1.6, 2, 0.5))],
        ["Bed"],
    ),
    "beds apart": ([BED[0], ("Bed_b", (3, 0, 0), (1.4, 2, 0.4))], ["Bed_frame", "Bed_b"]),
    "a chair of parts": (CHAIR, ["Chair"]),
    "four chairs of parts at a table": (
        [part for i in range(4) for part in moved(CHAIR, 0.46 * (i % 2), 1.4 * (i // 2), i + 1)],
        ["Chair_1", "Chair_2", "Chair_3", "Chair_4"],
    ),
    "four whole chairs that touch": (
        [part for i in range(4) for part in moved(WHOLE_CHAIR, 0.45 * i)],
        ["Chair"] * 4,
    ),
    "stacked chairs": (
        [("Chair.001", (0, 0, 0), (0.5, 0.5, 0.9)), ("Chair.002", (0, 0, 0.1), (0.5, 0.5, 0.9))],
        ["Chair.001", "Chair.002"],
    ),
    "a turned twin": (
        [("Sofa_a", (0, 0, 0), (2, 0.9, 0.8)), ("Sofa_b", (0.5, 0, 0), (0.9, 2, 0.8))],
        ["Sofa_a", "Sofa_b"],
    ),
    "too long for one": (
        [("Sofa_a", (0, 0, 0), (3.9, 0.9, 0.8)), ("Sofa_b", (2.2, 0, 0), (3, 0.9, 0.7))],
        ["Sofa_a", "Sofa_b"],
    ),
    "a couch and its cushions": (
        [("Sofa", (0, 0, 0), (2, 0.9, 0.8)), ("Sofa_cushion", (0.2, 0.1, 0.45), (0.5, 0.5, 0.15))],
        ["Sofa"],
    ),
    "a plant in its pot": (
        [("Plant_pot", (0, 0, 0), (0.3, 0.3, 0.3)), ("Plant_leaves", (-0.2, -0.2, 0.3), (0.7, 0.7, 0.8))],
        ["Plant"],
    ),
    "plants in a row": (
        [(f"Plant_{i}", (0.3 * i, 0, 0), (0.3, 0.3, 0.5 + 0.1 * i)) for i in range(3)],
        ["Plant_0", "Plant_1", "Plant_2"],
    ),
    "no body to hang on": (CHAIR[1:3], ["Chair_back", "Chair_leg_0"]),
    "classes that differ": ([BED[0], ("Sofa_x", (0, 0, 0.3), (1.6, 2, 0.3))], ["Bed_frame", "Sofa_x"]),
    "a class without parts": (
        [("Wall_a", (0, 0, 0), (4, 0.1, 2.5)), ("Wall_b", (0, 0, 0), (4, 0.1, 2.5))],
        ["Wall_a", "Wall_b"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_parts_that_are_one_thing(case: str) -> None:
    parts, expected = CASES[case]
    found = whole_things(pieces(parts))
    assert sorted(piece.name for piece in found) == sorted(expected)
    assert sum(len(piece.meshes) for piece in found) == len(parts)
    shuffled = [parts[i] for i in np.random.default_rng(5).permutation(len(parts))]
    assert sorted(piece.name for piece in whole_things(pieces(shuffled))) == sorted(expected)


def test_what_a_file_states_is_left_alone() -> None:
    stated = [MeshPart(name, "bed", (box(low, size),)) for name, low, size in BED]
    assert whole_things(stated) == stated


def test_many_parts_in_one_place_end() -> None:
    boxes = np.tile(np.array([[0.0, 0, 0], [2, 2, 0.5]]), (800, 1, 1))
    (group,) = groups_of(boxes, ["bed"] * 800, thing_sizes()["bed"])
    assert len(group) == 800
    boxes[:, :, 2] += 0.1 * np.arange(800)[:, None]
    assert groups_of(boxes, ["bed"] * 800, thing_sizes()["bed"]) == []


def test_a_bed_of_nodes_is_one_bed_of_the_scene(hall: Callable[..., Path]) -> None:
    def furnish(header: dict[str, Any]) -> None:
        for name, at, size in (*BED, *moved(WHOLE_CHAIR, 3, 1), *moved(WHOLE_CHAIR, 3.45, 1)):
            # The hall itself, 6 x 3 x 5 m in glTF's axes, shrunk to a part; z up is y there, and y is -z.
            node = {"name": name, "mesh": 0, "scale": [size[0] / 6, size[2] / 3, size[1] / 5]}
            header["nodes"].append({**node, "translation": [at[0] + 1, at[2], -at[1] - 1]})
        header["scenes"][0]["nodes"] = list(range(len(header["nodes"])))

    scene = open_building(str(hall(furnish)))
    assert [i.label for i in scene.instances] == ["", "bed", "chair", "chair"]
    assert scene.instances[1].p_min == pytest.approx((1, 1, 0), abs=1e-5)
    assert scene.instances[1].p_max == pytest.approx((2.65, 3.1, 1.1), abs=1e-5)
