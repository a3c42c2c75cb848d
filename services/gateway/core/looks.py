"""A look at a camera."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import msgspec


class Look(msgspec.Struct, frozen=True):
    """Somebody was shown a view of a camera. ``what``: "thumbnail", "latest", "tile", "history" or "recording" (view -1: all);
    ``client``: an address."""

    time: Annotated[datetime, msgspec.Meta(tz=True)]
    client: str
    camera: str
    view: int
    what: str
