"""Messages with which people have past pictures deleted."""

from __future__ import annotations

from surveilnav.messages.base import Message


class ForgetPictures(Message, frozen=True, kw_only=True):
    """Asks all who keep past pictures to delete them."""

    reason: str = ""


class PicturesForgotten(Message, frozen=True, kw_only=True):
    """Answer of one ``keeper``. ``message``: what it deletes, for people."""

    keeper: str
    message: str
