"""How large things of a class are: a radiator that a detector calls a bed is no bed, and a rug is nothing but a rug."""

from __future__ import annotations

from typing import NamedTuple


class Size(NamedTuple):
    """Bounds [m] on what was seen of an object: its longest horizontal extent (least and most), its least height, its
    least extent, how high above the floor it reaches at most, and the volume of its box at most [m3]."""

    least_m: float
    most_m: float
    high_m: float = 0.0
    thick_m: float = 0.0
    top_m: float = float("inf")
    bulk_m3: float = float("inf")


#: At least about half of the smallest that is sold, since views are partial (a crib is 1.2 m long, a loveseat 1.2 m wide, a
#: toilet 0.35 m wide); at most two side by side. Least heights and thicknesses lie below those of all but a few in a hundred
#: true objects of training buildings, and above those of every other false one. So do the tops, the other way round: half
#: of the false chairs and toilets reach higher above the floor than 98 of 100 true ones (pictures, lamps, wall cupboards),
#: half of the false tvs are bulkier than 95 of 100 true ones (cupboards).
#: Other classes: anything goes.
SIZES: dict[str, Size] = {
    "bed": Size(0.8, 3.2, 0.25, 0.2, 2.1),
    "couch": Size(0.7, 4.0, 0.3, 0.2, 1.3),
    "chair": Size(0.25, 1.3, 0.13, 0.08, 1.25, 0.8),
    "toilet": Size(0.25, 1.1, 0.25, 0.22, 1.15, 0.45),
    "tv": Size(0.3, 2.2, 0.35, 0.06, 2.2, 0.9),
    "potted plant": Size(0.08, 1.2, 0.13, 0.08, 2.45, 0.6),
    "dining table": Size(0.5, 5.0),
    "refrigerator": Size(0.4, 2.0),
}
_ANY = Size(0.0, float("inf"))


def misfit(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """Why an object of ``size_m`` (x, y, z extents) that reaches ``top_m`` above the floor can't be of this class, for
    people; empty if it can."""
    if too_much := outgrown(label, size_m, top_m):
        return too_much
    size = SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m < size.least_m:
        return f"too small for a {label}: {extent_m:.2f} m of at least {size.least_m:g} m"
    if size_m[2] < size.high_m:
        return f"too flat for a {label}: {size_m[2]:.2f} m high of at least {size.high_m:g} m"
    if min(size_m) < size.thick_m:
        return f"too thin for a {label}: {min(size_m):.2f} m of at least {size.thick_m:g} m"
    return ""


def outgrown(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """The part of ``misfit`` that no further view can mend: what is too large, too bulky or reaches too high."""
    size = SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m > size.most_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {size.most_m:g} m"
    if top_m > size.top_m:
        return f"too high for a {label}: up to {top_m:.2f} m above the floor of at most {size.top_m:g} m"
    bulk_m3 = size_m[0] * size_m[1] * size_m[2]
    if bulk_m3 > size.bulk_m3:
        return f"too bulky for a {label}: a box of {bulk_m3:.2f} m3 of at most {size.bulk_m3:g} m3"
    return ""
