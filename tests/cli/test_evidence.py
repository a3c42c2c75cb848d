"""What the report asks of a running system: what can't be read or isn't told is left out, and said so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import structlog

from surveilnav.bus import Unanswered
from surveilnav.cli.evidence import layers, objects
from surveilnav.geometry import Grid
from surveilnav.messages import LayerHeader
from surveilnav.sensing.packing import pack_array

GRID = Grid(0.0, 0.0, 0.05, 4, 5)


class Fusion:
    """A node behind which fusion answers with explored cells whatever it is asked, but to "frontier" not at all."""

    def __init__(self) -> None:
        self.log = structlog.get_logger()

    def ask(self, stream: Any, *, floor: str, layer: str = "", parameters: dict[str, str] | None = None) -> Any:
        if layer in ("", "frontier"):
            raise Unanswered("nobody is there")
        name = "explored" if layer == "occupancy" else layer
        header = LayerHeader(
            stamp_ns=1,
            floor=floor,
            layer=name,
            revision=1,
            grid=GRID,
            dtype="uint8",
            shape=(4, 5),  # type: ignore[arg-type]
        )
        return SimpleNamespace(message=header, payload=pack_array(np.ones((4, 5), np.uint8)))


def test_layers_that_cant_be_read_are_left_out():
    with structlog.testing.capture_logs() as said:
        found = layers(Fusion(), "0", "tv")  # type: ignore[arg-type]
    assert list(found) == ["explored"]
    assert found["explored"][0] == GRID
    assert {entry["layer"] for entry in said} == {"occupancy", "frontier", "value"}


def test_objects_that_nobody_tells_are_none():
    with structlog.testing.capture_logs() as said:
        assert objects(Fusion(), "0") == []  # type: ignore[arg-type]
    assert len(said) == 1
