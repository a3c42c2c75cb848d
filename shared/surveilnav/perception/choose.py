"""Chooses the backend that runs, and says why, for console and report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.backend import Backend
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import PRESETS, NetworkSettings

#: What "auto" tries in real buildings, in this order.
BEST: tuple[BackendName, ...] = (BackendName.ONNX_COCO, BackendName.COMPACT)
#: The same in simulated buildings: ``compact`` was trained on such, knows more classes and needs no download
#: (``docs/understand/compact.md`` compares the two).
BEST_IN_SIMULATION: tuple[BackendName, ...] = (BackendName.COMPACT, BackendName.ONNX_COCO)

_BEST = "the best that runs here"
_LIKE_THESE = "chosen for a simulated building: it learnt from such"

#: Makes a backend, given the reason why it was chosen.
BackendFactory = Callable[[str], Backend]
_NONE: Mapping[str, BackendFactory] = MappingProxyType({})


def choose_backend(
    name: str = "auto",
    networks: NetworkSettings | None = None,
    *,
    simulated: bool = False,
    others: Mapping[str, BackendFactory] = _NONE,
    fallback: str = "",
) -> Backend:
    """Makes the backend of that name; for "auto", the best one that can run here.

    Args:
        simulated: whether the building is simulated, which decides what is best.
        others: by name, the backends of a simulator, which this library doesn't know.
        fallback: the one of them that "auto" takes if no real detector can run; empty: none.

    Raises:
        PerceptionError: the backend can't run; the message says what is missing.
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
    names, why = (BEST_IN_SIMULATION, _LIKE_THESE) if simulated else (BEST, _BEST)
    return _first_that_runs(networks, names, why, others[fallback] if fallback else None)


def _first_that_runs(
    networks: NetworkSettings, names: Sequence[BackendName], why_first: str, fallback: BackendFactory | None
) -> Backend:
    """The first backend that runs, else the fallback. Raises PerceptionError if there is none."""
    faults: list[str] = []
    for name in names:
        if name == BackendName.COMPACT and not _has_compact():
            continue
        try:
            return PRESETS[name](networks, "; ".join([_BEST if faults else why_first, *faults]))
        except PerceptionError as error:
            faults.append(f"{name} can't run: {error}")
    if fallback is None:
        raise PerceptionError("; ".join(faults))
    return fallback(f"no real detector: {'; '.join(faults)}")


def _has_compact() -> bool:
    """Whether the weights of ``compact`` are installed. If not, "auto" doesn't mention it."""
    return models.is_here(BackendName.COMPACT)
