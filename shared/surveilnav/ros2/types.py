"""Encoding of ROS 2 messages as CDR, and their type hashes, by rosbags."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from surveilnav.errors import WireError
from surveilnav.ros2.nav2_actions import DEFINITIONS

#: How a request, a response or a part of an action is named among messages: rosbags knows messages alone.
_AS_MESSAGE = {"srv": "msg", "action": "msg"}


@cache
def _store() -> Any:
    """The types of ROS 2 Jazzy and Nav2's action. Earlier and later distributions have the same messages of sensors."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


def make(type_name: str, **fields: Any) -> Any:
    """A message. Fields must be all there, in any order; nested ones are messages, too."""
    return _store().types[_as_message(type_name)](**fields)


def encode(message: Any) -> bytes:
    """A message of ``make`` as CDR, with its header of four bytes."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def decode(data: bytes, type_name: str) -> Any:
    """A message from CDR. Raises WireError: it isn't one of that type, or the type isn't known."""
    name = _as_message(type_name)
    if name not in _store().fielddefs:
        raise WireError(f"messages of type {type_name!r:.80} can't be read")
    try:
        return _store().deserialize_cdr(data, name)
    except Exception as error:  # rosbags raises whatever a truncated buffer makes its generated code raise
        raise WireError(
            f"expected a {type_name} of {len(data)} bytes as CDR: {type(error).__name__} {error}"
        ) from error


def type_hash(type_name: str) -> str:
    """``RIHS01_...`` of a message (REP-2016). Of services, and of parts of actions, only ROS's own end can tell the right one."""
    hashed: str = _store().hash_rihs01(_as_message(type_name))
    return hashed


def _as_message(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    return f"{package}/{_AS_MESSAGE.get(kind, kind)}/{name}"
