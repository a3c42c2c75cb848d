"""A piece of furniture in the making."""

from __future__ import annotations

import numpy as np

from surveilnav.simulator.furniture.parametric import prism
from surveilnav.simulator.world.assembly import MeshBuilder
from surveilnav.simulator.world.scene import Material
from training.detector.materials import painted, patterned

METAL = Material("metal", (0.62, 0.63, 0.65), shininess=0.5)


class Drawing:
    """The mesh of a piece, the size ``w``, ``d``, ``h`` [m] that it fills, and the chance that shapes it.

    Local frame as in ``surveilnav.simulator.furniture.parametric``: x to the right, y to the back, z up, standing on z = 0.
    """

    def __init__(self, size_m: tuple[float, float, float], rng: np.random.Generator) -> None:
        self.mesh, self.rng = MeshBuilder(), rng
        self.w, self.d, self.h = size_m

    def box(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], material: Material) -> None:
        """An axis-aligned box [m]."""
        self.mesh.box((x[0], y[0], z[0]), (x[1], y[1], z[1]), material, tile_m=0.5)

    def post(self, x: float, y: float, r: float, z: tuple[float, float], material: Material, top: float = 1.0) -> None:
        """An upright round body of radius ``r``, at its upper end ``top`` times that."""
        prism(self.mesh, x, y, r, top * r, z[0], z[1], material, sides=8)

    def between(self, low: float, high: float) -> float:
        """A number of that range."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in that share of all pieces."""
        return bool(self.rng.random() < share)

    def wood_or_paint(self) -> Material:
        """What frames are made of; metal at times."""
        kind = self.rng.random()
        if kind < 0.5:
            return patterned(self.rng, "wood")
        return METAL if kind < 0.6 else painted(self.rng)

    def fabric(self) -> Material:
        """Plain cloth, or a pattern."""
        return patterned(self.rng) if self.chance(0.4) else painted(self.rng)

    def linen(self) -> Material:
        """Light cloth."""
        r, g, b = self.rng.uniform(0.75, 0.97, 3)
        return Material("linen", (float(r), float(g), float(b)))
