"""How large things of a class are: a radiator that a detector calls a bed is no bed, and a rug is nothing but a rug."""

from __future__ import annotations

from typing import NamedTuple


class Size(NamedTuple):
    """Bounds [m] on what was seen of an object: its longest horizontal extent, its height, its least extent."""

    least_m: float
    most_m: float
    high_m: float = 0.0
    thick_m: float = 0.0


#: At least about half of the smallest that is sold, since views are partial (a crib is 1.2 m long, a loveseat 1.2 m wide, a
#: toilet 0.35 m wide); at most two side by side. Heights and thicknesses lie below those of all but a few in a hundred
#: true objects of training buildings, and above those of every other false one. Other classes: anything goes.
SIZES: dict[str, Size] = {
    "bed": Size(0.8, 4.0, 0.25, 0.2),
    "couch": Size(0.7, 5.0, 0.3, 0.2),
    "chair": Size(0.25, 2.0, 0.13, 0.08),
    "toilet": Size(0.25, 1.2, 0.25, 0.22),
    "tv": Size(0.3, 2.5, 0.35, 0.03),
    "potted plant": Size(0.08, 2.5, 0.13, 0.08),
    "dining table": Size(0.5, 5.0),
    "refrigerator": Size(0.4, 2.0),
}
_ANY = Size(0.0, float("inf"))


def misfit(label: str, size_m: tuple[float, float, float]) -> str:
    """Why an object of ``size_m`` (x, y, z extents) can't be of this class, for people; empty if it can."""
    size = SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m < size.least_m:
        return f"too small for a {label}: {extent_m:.2f} m of at least {size.least_m:g} m"
    if extent_m > size.most_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {size.most_m:g} m"
    if size_m[2] < size.high_m:
        return f"too flat for a {label}: {size_m[2]:.2f} m high of at least {size.high_m:g} m"
    if min(size_m) < size.thick_m:
        return f"too thin for a {label}: {min(size_m):.2f} m of at least {size.thick_m:g} m"
    return ""
