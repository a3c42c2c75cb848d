"""Which kinds of pieces furnish a generated building, and how each is placed: ``data/pieces.json``."""

from __future__ import annotations

from importlib import resources

import msgspec


class PieceKind(msgspec.Struct, frozen=True):
    """A kind of piece.

    Attributes:
        catalog: the catalogue entry that stands for it, which is swapped for a model of that kind.
        front_m: ground before it that stays free of other pieces.
        in_corner: whether it is put into a corner where one is free.
    """

    catalog: str = ""
    front_m: float = 0.4
    in_corner: bool = False


class _Table(msgspec.Struct):
    pieces: dict[str, PieceKind]


#: By name, in the order in which a room gets them.
PIECES: dict[str, PieceKind] = msgspec.json.decode(
    resources.files("surveilnav.simulator.procedural").joinpath("data/pieces.json").read_bytes(), type=_Table
).pieces
