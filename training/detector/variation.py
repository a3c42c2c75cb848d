"""A building as nobody furnished it: other colours, other proportions, and drawn pieces in the place of some.

The libraries have two to fifteen models of a goal for training. Without variation a network learns those by heart.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.world.assembly import Mesh, SceneBuilder
from surveilnav.simulator.world.labels import PARTS
from surveilnav.simulator.world.scene import Instance, Material, Scene
from training.detector.furniture import DRAWN, drawn_piece
from training.detector.materials import colour, painted, patterned

#: Of all pieces: drawn anew where their class is one of ``DRAWN``; in other colours.
_DRAWN_SHARE, _RECOLOURED_SHARE = 0.7, 0.6
#: Of walls, floors and ceilings.
_REPAINTED_SHARE = 0.5
#: Standard deviation of the logarithm of each side.
_STRETCH = 0.12
_MAX_STRETCH = 0.3
_IN_FRONT_M = 0.7
#: So often a drawn piece faces any of its ways, not the room: backs of tvs and couches show, too.
_ANY_WAY_SHARE = 0.25
#: Standard deviation of how far a drawn piece is turned from there [rad]; beds and toilets stand straight.
_TURN_RAD = {"chair": 0.35, "potted plant": 1.0, "tv": 0.25, "couch": 0.08}


def varied_scene(scene: Scene, seed: int) -> Scene:
    """The building with other surfaces and other furniture at the same places; the same for the same seed.

    Instances keep their names, labels and floors. What a class is stays true: only goals are drawn anew, as goals.
    """
    rng = np.random.default_rng([seed, 7])
    builder = SceneBuilder(f"{scene.name}-v{seed}", list(scene.rooms), list(scene.floors), list(scene.stairs))
    paints: dict[int, Material] = {}
    by_instance = np.argsort(scene.instance_of_triangle, kind="stable")
    ends = np.searchsorted(scene.instance_of_triangle[by_instance], np.arange(len(scene.instances) + 2))
    for instance in scene.instances:
        triangles = by_instance[ends[instance.id] : ends[instance.id + 1]]
        mesh = _varied_mesh(scene, instance, triangles, paints, rng)
        builder.add(mesh, instance.name, instance.label, instance.floor, model=instance.model, room=instance.room)
    return builder.build(scene.source)


def _varied_mesh(
    scene: Scene, instance: Instance, triangles: NDArray[np.intp], paints: dict[int, Material], rng: np.random.Generator
) -> Mesh:
    own = _mesh_of(scene, triangles)
    if instance.label in PARTS:
        return replace(own, materials=tuple(_repainted(m, paints, rng) for m in own.materials))
    if instance.label in DRAWN and rng.random() < _DRAWN_SHARE:
        return _drawn(scene, instance, rng)
    if rng.random() < _RECOLOURED_SHARE:
        own = replace(own, materials=tuple(_recoloured(m, rng) for m in own.materials))
    return _stretched(own, rng)


def _mesh_of(scene: Scene, triangles: NDArray[np.intp]) -> Mesh:
    """One instance's own mesh, with the materials that it uses."""
    used, corners = np.unique(scene.triangles[triangles], return_inverse=True)
    kinds, material = np.unique(scene.material_of_triangle[triangles], return_inverse=True)
    return Mesh(
        scene.vertices[used],
        corners.reshape(-1, 3).astype(np.int32),
        scene.uvs[triangles],
        material.reshape(-1).astype(np.int32),
        tuple(scene.materials[k] for k in kinds),
    )


def _repainted(material: Material, paints: dict[int, Material], rng: np.random.Generator) -> Material:
    """Walls and floors that shared a surface go on sharing one."""
    if id(material) not in paints:
        new = material
        if material.alpha >= 1.0 and rng.random() < _REPAINTED_SHARE:
            new = patterned(rng) if rng.random() < 0.3 else replace(material, color=_near(material.color, rng))
        paints[id(material)] = new
    return paints[id(material)]


def _recoloured(material: Material, rng: np.random.Generator) -> Material:
    if material.alpha < 1.0:
        return material
    kind = rng.random()
    if kind < 0.25:
        return patterned(rng, "wood" if rng.random() < 0.4 else "any")
    if kind < 0.45:
        return painted(rng)
    return replace(material, color=_near(material.color, rng))


def _near(color: tuple[float, float, float], rng: np.random.Generator) -> tuple[float, float, float]:
    """A colour between the old one and another."""
    share = rng.uniform(0.2, 0.8)
    r, g, b = (float((1 - share) * old + share * new) for old, new in zip(color, colour(rng), strict=True))
    return r, g, b


def _stretched(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Other proportions around the middle of its foot."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    T = np.diag([*np.exp(np.clip(rng.normal(0.0, _STRETCH, 3), -_MAX_STRETCH, _MAX_STRETCH)), 1.0])
    T[:3, 3] = foot - T[:3, :3] @ foot
    return mesh.moved(T)


def _drawn(scene: Scene, instance: Instance, rng: np.random.Generator) -> Mesh:
    """A drawn piece of about the size of the instance, in its place, its front to the room."""
    low, high = np.array(instance.p_min), np.array(instance.p_max)
    size = (high - low) * np.exp(np.clip(rng.normal(0.0, _STRETCH, 3), -_MAX_STRETCH, _MAX_STRETCH))
    size = np.maximum(size, 0.08)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    quarter = _facing(scene, instance, foot[:2], size, rng)
    w, d = (size[0], size[1]) if quarter % 2 == 0 else (size[1], size[0])
    turn = quarter * np.pi / 2 + rng.normal(0.0, _TURN_RAD.get(instance.label, 0.0))
    c, s = np.cos(turn), np.sin(turn)
    T = np.eye(4)
    T[:2, :2], T[:3, 3] = [[c, -s], [s, c]], foot
    return drawn_piece(instance.label, (float(w), float(d), float(size[2])), rng).moved(T)


def _facing(
    scene: Scene, instance: Instance, middle: NDArray[np.float64], size: NDArray[np.float64], rng: np.random.Generator
) -> int:
    """By how many quarters a piece that looks to -y is turned: a bed along its longer side, a couch or tv across; of the
    two ways left, the one that looks farther into the room."""
    along = {"bed": 0, "couch": 1, "tv": 1}.get(instance.label)
    quarters = [0, 1, 2, 3]
    if along is not None:
        is_wide = size[0] >= size[1]
        quarters = [q for q in quarters if (q % 2 == 0) == (is_wide == (along == 1))]
    order = rng.permutation(quarters)
    if rng.random() < _ANY_WAY_SHARE:
        return int(order[0])
    polygons = [np.array(r.polygon_m, np.float32) for r in scene.rooms if r.floor == instance.floor]
    inside = [p for p in polygons if cv2.pointPolygonTest(p, _point(middle), measureDist=False) >= 0]
    if not inside:
        return int(order[0])

    def room_ahead(quarter: int) -> float:
        ahead = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)][quarter])
        return float(cv2.pointPolygonTest(inside[0], _point(middle + _IN_FRONT_M * ahead), measureDist=True))

    return int(max(order, key=room_ahead))


def _point(p: NDArray[np.float64]) -> tuple[float, float]:
    return float(p[0]), float(p[1])
