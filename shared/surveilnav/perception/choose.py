"""Which backend runs, and why: in words for the console and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.backend import Backend
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import PRESETS, NetworkSettings

#: What "auto" takes, the first that runs.
BEST: tuple[BackendName, ...] = (BackendName.ONNX_COCO, BackendName.COMPACT)
#: The same in simulated buildings: ``compact`` learnt from their like, knows more classes and needs no download
#: (``docs/understand/compact.md`` has what both find).
BEST_IN_SIMULATION: tuple[BackendName, ...] = (BackendName.COMPACT, BackendName.ONNX_COCO)

_BEST = "the best that runs here"
_LIKE_THESE = "chosen for a simulated building: it learnt from such"

#: Makes a backend that is told why it runs.
Maker = Callable[[str], Backend]
_NONE: Mapping[str, Maker] = MappingProxyType({})


def choose_backend(
    name: str = "auto",
    networks: NetworkSettings | None = None,
    *,
    simulated: bool = False,
    others: Mapping[str, Maker] = _NONE,
    stand_in: str = "",
) -> Backend:
    """The backend of that name; "auto" takes the best that can run without being asked for.

    Args:
        networks: what settings say of the models.
        simulated: whether the building is; it decides what is best.
        others: backends that this library doesn't have, by name: those of a simulator.
        stand_in: which of them "auto" takes where no real detector can run; empty: none.

    Raises:
        PerceptionError: it can't run; the message says what is missing.
    """
    networks = networks or NetworkSettings()
    if name in others:
        return others[name]("asked for by name")
    if name in PRESETS:
        return PRESETS[name](networks, "asked for by name")
    if name != "auto":
        raise PerceptionError(
            f"expected a perception backend out of {', '.join((BackendName.AUTO, *PRESETS, *others))}, got {name!r}"
        )
    names, of = (BEST_IN_SIMULATION, _LIKE_THESE) if simulated else (BEST, _BEST)
    return _best(networks, names, of, others[stand_in] if stand_in else None)


def _best(networks: NetworkSettings, names: Sequence[BackendName], why_first: str, stand_in: Maker | None) -> Backend:
    """The first that runs, else the stand-in. PerceptionError: neither."""
    faults: list[str] = []
    for name in names:
        if name == BackendName.COMPACT and not _has_compact():
            continue
        try:
            return PRESETS[name](networks, "; ".join([_BEST if faults else why_first, *faults]))
        except PerceptionError as error:
            faults.append(f"{name} can't run: {error}")
    if stand_in is None:
        raise PerceptionError("; ".join(faults))
    return stand_in(f"no real detector: {'; '.join(faults)}")


def _has_compact() -> bool:
    """Whether weights lie where ``compact`` has them; without, nobody expects it."""
    return models.is_here(BackendName.COMPACT)
