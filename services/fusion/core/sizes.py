"""How large things of a class are: a radiator that a detector calls a bed is no bed."""

from __future__ import annotations

#: Longest horizontal extent [m] of what was seen of an object: at least (about half of the smallest that is sold: a crib
#: is 1.2 m long, a loveseat 1.2 m wide, a toilet 0.35 m wide), at most (two side by side). Other classes: anything goes.
EXTENT_M: dict[str, tuple[float, float]] = {
    "bed": (1.1, 4.0),
    "couch": (1.0, 5.0),
    "chair": (0.25, 2.0),
    "toilet": (0.25, 1.2),
    "tv": (0.3, 2.5),
    "potted plant": (0.08, 2.5),
    "dining table": (0.5, 5.0),
    "refrigerator": (0.4, 2.0),
}


def misfit(label: str, size_m: tuple[float, float, float]) -> str:
    """Why an object of ``size_m`` (x, y, z extents) can't be of this class, for people; empty if it can."""
    least_m, most_m = EXTENT_M.get(label, (0.0, float("inf")))
    extent_m = max(size_m[0], size_m[1])
    if extent_m < least_m:
        return f"too small for a {label}: {extent_m:.2f} m of at least {least_m:g} m"
    if extent_m > most_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {most_m:g} m"
    return ""
