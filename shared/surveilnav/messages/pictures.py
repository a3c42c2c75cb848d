"""Pictures that are kept, and shall not be."""

from __future__ import annotations

from surveilnav.messages.base import Message


class ForgetPictures(Message, frozen=True, kw_only=True):
    """Asks whoever keeps past pictures to forget them."""

    reason: str = ""


class PicturesForgotten(Message, frozen=True, kw_only=True):
    """What ``keeper`` does about it, for people."""

    keeper: str
    message: str
