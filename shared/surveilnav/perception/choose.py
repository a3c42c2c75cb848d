"""Which backend runs, and why: in words for the console and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from surveilnav.errors import PerceptionError
from surveilnav.perception.backend import Backend
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import PRESETS, Networks

#: What "auto" takes where it can run.
AUTO = BackendName.ONNX_COCO

#: Makes a backend that is told why it runs.
Maker = Callable[[str], Backend]
_NONE: Mapping[str, Maker] = MappingProxyType({})


def choose_backend(
    name: str = "auto", networks: Networks | None = None, *, others: Mapping[str, Maker] = _NONE, stand_in: str = ""
) -> Backend:
    """The backend of that name; "auto" takes the best that can run without being asked for.

    Args:
        networks: what settings say of the models.
        others: backends that this library doesn't have, by name: those of a simulator.
        stand_in: which of them "auto" takes where no real detector can run; empty: none.

    Raises:
        PerceptionError: it can't run; the message says what is missing.
    """
    networks = networks or Networks()
    if name in others:
        return others[name]("asked for by name")
    if name in PRESETS:
        return PRESETS[name](networks, "asked for by name")
    if name != "auto":
        raise PerceptionError(
            f"expected a perception backend out of {', '.join((BackendName.AUTO, *PRESETS, *others))}, got {name!r}"
        )
    try:
        return PRESETS[AUTO](networks, "the best that runs here")
    except PerceptionError as error:
        if not stand_in:
            raise
        return others[stand_in](f"no real detector: {AUTO} can't run: {error}")
