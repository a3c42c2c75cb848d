"""How large things of a class are: a radiator that a detector calls a bed is no bed, and a rug is nothing but a rug."""

from __future__ import annotations

import msgspec

from surveilnav.perception.vocabulary import COCO


class SizePrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds on what was seen of an object of a class. An object's box is axis-aligned.

    Least extents are about half of the smallest that is sold, since views are partial: a crib is 1.2 m long, a loveseat
    1.2 m wide, a toilet 0.35 m wide. Largest extents are two side by side. Least heights and thicknesses lie below those
    of all but a few in a hundred true objects of training buildings, and above those of every other false one. Tops are
    chosen the other way round: half of the false chairs and toilets reach higher than 98 of 100 true ones (pictures,
    lamps, wall cupboards). Half of the false tvs are bulkier than 95 of 100 true ones (cupboards).

    Attributes:
        extent_min_m, extent_max_m: of the longer horizontal side.
        height_min_m: of the vertical side.
        thickness_min_m: of the shortest of all three sides.
        top_max_m: how high above the floor it reaches at most.
        volume_max_m3: of its box.
    """

    extent_min_m: float = 0.0
    extent_max_m: float = float("inf")
    height_min_m: float = 0.0
    thickness_min_m: float = 0.0
    top_max_m: float = float("inf")
    volume_max_m3: float = float("inf")


class _Priors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the library's ``data/coco/priors.json`` says to fusion: bounds by class name; anything goes for other classes."""

    size: dict[str, SizePrior]


_SIZES = COCO.priors("fusion", _Priors).size
_ANY = SizePrior()


def misfit(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """Why an object of ``size_m`` (x, y, z extents) that reaches ``top_m`` above the floor can't be of this class, for
    people; empty if it can."""
    if too_much := outgrown(label, size_m, top_m):
        return too_much
    prior = _SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m < prior.extent_min_m:
        return f"too small for a {label}: {extent_m:.2f} m of at least {prior.extent_min_m:g} m"
    if size_m[2] < prior.height_min_m:
        return f"too flat for a {label}: {size_m[2]:.2f} m high of at least {prior.height_min_m:g} m"
    if min(size_m) < prior.thickness_min_m:
        return f"too thin for a {label}: {min(size_m):.2f} m of at least {prior.thickness_min_m:g} m"
    return ""


def outgrown(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """The part of ``misfit`` that no further view can mend: what is too large, too bulky or reaches too high."""
    prior = _SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m > prior.extent_max_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {prior.extent_max_m:g} m"
    if top_m > prior.top_max_m:
        return f"too high for a {label}: up to {top_m:.2f} m above the floor of at most {prior.top_max_m:g} m"
    volume_m3 = size_m[0] * size_m[1] * size_m[2]
    if volume_m3 > prior.volume_max_m3:
        return f"too bulky for a {label}: a box of {volume_m3:.2f} m3 of at most {prior.volume_max_m3:g} m3"
    return ""
