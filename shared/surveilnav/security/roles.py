"""Roles of people and programs that use the REST interface."""

from __future__ import annotations

from enum import IntEnum


class Role(IntEnum):
    """What a key is good for; each role may also do what those before it may."""

    viewer = 1
    operator = 2
    admin = 3
