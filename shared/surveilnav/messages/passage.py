"""Doors and lifts: whether robots can pass them."""

from __future__ import annotations

from typing import Literal

from surveilnav.messages.base import Message


class PassageState(Message, frozen=True, kw_only=True):
    """Whether robots can pass a door or a lift, as whoever moves it says. On change, and at least every few seconds.

    Attributes:
        state: "unknown": whoever publishes can't tell, which is the same as no message.
        message: details, for people.
    """

    state: Literal["open", "closed", "unknown"]
    message: str = ""
