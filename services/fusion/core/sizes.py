"""How large things of a class are: a radiator that a detector calls a bed is no bed, and a rug is nothing but a rug."""

from __future__ import annotations

from typing import NamedTuple


class Size(NamedTuple):
    """Bounds [m] on what was seen of an object: its longest horizontal extent (least and most), its least height, its
    least extent, its greatest height."""

    least_m: float
    most_m: float
    high_m: float = 0.0
    thick_m: float = 0.0
    tall_m: float = float("inf")


#: At least about half of the smallest that is sold, since views are partial (a crib is 1.2 m long, a loveseat 1.2 m wide, a
#: toilet 0.35 m wide); at most two side by side. Least heights and thicknesses lie below those of all but a few in a hundred
#: true objects of training buildings, and above those of every other false one. What is
#: as tall as a storey is mostly wall: a quarter of the false ones are, one true one in fifty. Other classes: anything goes.
SIZES: dict[str, Size] = {
    "bed": Size(0.8, 3.2, 0.25, 0.2, 2.2),
    "couch": Size(0.7, 4.0, 0.3, 0.2, 1.5),
    "chair": Size(0.25, 1.3, 0.13, 0.08, 1.5),
    "toilet": Size(0.25, 1.1, 0.25, 0.22, 1.4),
    "tv": Size(0.3, 2.2, 0.35, 0.03, 1.5),
    "potted plant": Size(0.08, 1.2, 0.13, 0.08, 2.3),
    "dining table": Size(0.5, 5.0),
    "refrigerator": Size(0.4, 2.0),
}
_ANY = Size(0.0, float("inf"))


def misfit(label: str, size_m: tuple[float, float, float]) -> str:
    """Why an object of ``size_m`` (x, y, z extents) can't be of this class, for people; empty if it can."""
    if too_much := outgrown(label, size_m):
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


def outgrown(label: str, size_m: tuple[float, float, float]) -> str:
    """The part of ``misfit`` that no further view can mend: what is too large or too tall."""
    size = SIZES.get(label, _ANY)
    extent_m = max(size_m[0], size_m[1])
    if extent_m > size.most_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {size.most_m:g} m"
    if size_m[2] > size.tall_m:
        return f"too tall for a {label}: {size_m[2]:.2f} m high of at most {size.tall_m:g} m"
    return ""
