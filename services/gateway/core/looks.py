"""A look at a camera."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import msgspec


class Look(msgspec.Struct, frozen=True):
    """Somebody was shown a view of a camera, as ``what``: "thumbnail", "latest" or "tile". Or got a "recording", which may
    hold any of its views: None. ``client``: an address."""

    time: Annotated[datetime, msgspec.Meta(tz=True)]
    client: str
    camera: str
    view: int | None
    what: str
