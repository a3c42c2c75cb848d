"""Floors, ceilings, and the edges of holes in them. Everything here is in the world frame: metres, z up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.polygons import Polygon, subtract
from surveilnav.simulator.world.scene import Material


def build_skirt(hole: Polygon, z_low_m: float, z_high_m: float, material: Material) -> Mesh:
    """The sides of a hole in a slab, seen from both sides."""
    mesh = MeshBuilder()
    for a, b in zip(hole, np.roll(hole, -1, axis=0), strict=True):
        quad = [(*a, z_low_m), (*b, z_low_m), (*b, z_high_m), (*a, z_high_m)]
        mesh.quad(quad, material)
        mesh.quad(quad[::-1], material)
    return mesh.mesh()


def build_slab(
    polygon: Polygon, z_m: float, material: Material, holes: Sequence[Polygon] = (), *, up: bool, tile_m: float = 1.0
) -> Mesh:
    """A floor (``up``) or ceiling: the polygon without its holes, its texture repeating every ``tile_m``."""
    return build_slabs([polygon], z_m, material, holes, up=up, tile_m=tile_m)


def build_slabs(
    polygons: Sequence[Polygon],
    z_m: float,
    material: Material,
    holes: Sequence[Polygon] = (),
    *,
    up: bool,
    tile_m: float = 1.0,
) -> Mesh:
    """Several polygons as one floor or ceiling."""
    mesh = MeshBuilder()
    for piece in (rest for polygon in polygons for rest in subtract(np.asarray(polygon, dtype=np.float64), holes)):
        ring = piece if up else piece[::-1]
        points = np.column_stack([ring, np.full(len(ring), z_m)])
        fan = np.array([[0, i, i + 1] for i in range(1, len(ring) - 1)], dtype=np.int32)
        mesh.triangles(points, fan, material, ring / tile_m)
    return mesh.mesh()
