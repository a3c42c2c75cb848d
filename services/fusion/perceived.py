"""A view between perception and the maps: the picture, and what perception found in it."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages import FrameHeader
from surveilnav.sensing.views import PosedView, ViewPerception

#: Source ("camera/<id>" or "robot/<id>") and index of the view.
ViewKey = tuple[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedView:
    """A view with perception's answer, ready to be logged and integrated.

    Attributes:
        key: source and index of the view.
        header: the frame's header, as it arrived.
        view: the decoded view; None if its picture is faulty, or if the maps hold exactly this picture already.
        perception: what was found in it; None if no detector looked at it.
        payload: the picture, as it arrived.
        reply: perception's reply, as it arrived.
        digest: hash of pose, picture, embedding model and the words that were looked for.
        fault: why the picture can't be used; "" if it can.
        request_id: the request that the frame belongs to; "": none. It isn't logged.
    """

    key: ViewKey
    header: FrameHeader
    view: PosedView | None = None
    perception: ViewPerception | None = None
    payload: bytes = b""
    reply: bytes = b""
    digest: bytes = b""
    fault: str = ""
    request_id: str = ""
