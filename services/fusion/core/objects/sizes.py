"""How large things of a class can be, and how high they stand. A radiator that a detector takes for a bed isn't one."""

from __future__ import annotations

import msgspec

from surveilnav.perception.vocabulary import COCO


class SizePrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds on the axis-aligned box of what was seen of an object of some class.

    Minimum extents are about half of the smallest that is sold, since views are partial: a crib is 1.2 m long, a loveseat
    1.2 m wide, a toilet 0.35 m wide. Maximum extents are those of two such things side by side. Minimum heights and
    thicknesses lie below those of all but a few percent of the true objects in the training buildings, and above those of
    half of the false ones. Maximum tops are chosen the same way: half of the false chairs and toilets (pictures, lamps, wall
    cupboards) reach higher than 98 % of the true ones. Half of the false tvs (cupboards) are bulkier than 95 % of the true
    ones.

    Attributes:
        extent_min_m, extent_max_m: of the longer horizontal side.
        height_min_m: of the vertical side.
        thickness_min_m: of the shortest of the three sides.
        top_max_m: the height above the floor that the object reaches.
        volume_max_m3: of the box.
    """

    extent_min_m: float = 0.0
    extent_max_m: float = float("inf")
    height_min_m: float = 0.0
    thickness_min_m: float = 0.0
    top_max_m: float = float("inf")
    volume_max_m3: float = float("inf")


class BasePrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How high above the floor the lowest point of a thing is: mean and standard deviation.

    By the usual heights of desks (0.72 m), worktops (0.9 m), sideboards and walls on which things of a class stand or hang.
    """

    height_m: float = 0.0
    sigma_m: float = 0.02


class _Priors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Fusion's part of the library's priors on COCO's classes. Other classes have no bounds and stand on the floor."""

    size: dict[str, SizePrior]
    base: dict[str, BasePrior]


_PRIORS = COCO.priors("fusion", _Priors)
_SIZES = _PRIORS.size
_UNBOUNDED = SizePrior()
_ON_FLOOR = BasePrior()


def base_prior(label: str) -> BasePrior:
    """How high things of a class stand above the floor."""
    return _PRIORS.base.get(label, _ON_FLOOR)


def size_mismatch(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """Why an object can't be of a class by its size, in words for people; empty if it can.

    Args:
        size_m: extents of the object's box along x, y, z.
        top_m: height of its top above the floor.
    """
    if reason := too_large(label, size_m, top_m):
        return reason
    prior = _SIZES.get(label, _UNBOUNDED)
    extent_m = max(size_m[0], size_m[1])
    if extent_m < prior.extent_min_m:
        return f"too small for a {label}: {extent_m:.2f} m of at least {prior.extent_min_m:g} m"
    if size_m[2] < prior.height_min_m:
        return f"too flat for a {label}: {size_m[2]:.2f} m high of at least {prior.height_min_m:g} m"
    if min(size_m) < prior.thickness_min_m:
        return f"too thin for a {label}: {min(size_m):.2f} m of at least {prior.thickness_min_m:g} m"
    return ""


def too_large(label: str, size_m: tuple[float, float, float], top_m: float) -> str:
    """The part of ``size_mismatch`` that further views can't correct: too large, too bulky, or reaching too high."""
    prior = _SIZES.get(label, _UNBOUNDED)
    extent_m = max(size_m[0], size_m[1])
    if extent_m > prior.extent_max_m:
        return f"too large for a {label}: {extent_m:.2f} m of at most {prior.extent_max_m:g} m"
    if top_m > prior.top_max_m:
        return f"too high for a {label}: up to {top_m:.2f} m above the floor of at most {prior.top_max_m:g} m"
    volume_m3 = size_m[0] * size_m[1] * size_m[2]
    if volume_m3 > prior.volume_max_m3:
        return f"too bulky for a {label}: a box of {volume_m3:.2f} m3 of at most {prior.volume_max_m3:g} m3"
    return ""
