"""What passes between the parts of the service: a view on its way into the maps, and the newest of a robot that is processed."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages import FrameHeader
from surveilnav.sensing.views import PosedView, ViewPerception

#: Source ("camera/<id>" or "robot/<id>") and index of the view.
ViewKey = tuple[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedView:
    """A view that perception has looked at.

    Attributes:
        key: its source and view.
        header: as it arrived.
        view: as arrays; None if its picture is of no use, or the one that the maps hold already.
        perception: what was seen in it; None where no detector looked.
        payload, reply: the picture and perception's reply, as they arrived.
        digest: of pose and picture.
        fault: why the picture is of no use; empty if it isn't.
    """

    key: ViewKey
    header: FrameHeader
    view: PosedView | None = None
    perception: ViewPerception | None = None
    payload: bytes = b""
    reply: bytes = b""
    digest: bytes = b""
    fault: str = ""


@dataclass(frozen=True, slots=True)
class LastObservation:
    """The newest observation of a robot that is processed, held or refused, and on which floor."""

    floor: str
    seq: int
    stamp_ns: int
