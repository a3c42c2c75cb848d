"""Which request is being worked on: an id that travels beside messages, and that stands in every log line about the request.

The gateway gives each HTTP request an id. Whatever is published or queried while the request is handled carries the id, and
whoever handles such a message works on that request, too. A mission works on the request that began it, until it ends.

On the bus the id is a further field of the attachment, which is a MessagePack map: the message's own map where the message is
the attachment, or else a map of its own. Programs that don't know the field pass over it, and where it is missing there is no id.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import msgspec

from surveilnav.contract import ID

P = ParamSpec("P")
T = TypeVar("T")
_ID = re.compile(ID)
#: The field, as it stands in an attachment and in a log line.
_FIELD = "request_id"
_FIELD_BYTES = _FIELD.encode()
_id: ContextVar[str] = ContextVar(_FIELD, default="")


class _Attached(msgspec.Struct):
    request_id: str = ""


_decoder = msgspec.msgpack.Decoder(_Attached)
_map_decoder = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])


def is_request_id(text: str) -> bool:
    """Whether a text may be the id of a request: at most 64 letters, digits, "_", "." and "-"."""
    return _ID.fullmatch(text) is not None


def request_id() -> str:
    """The id of the request that this thread works on; "": it works on none."""
    return _id.get()


@contextmanager
def bound_request_id(id: str) -> Iterator[None]:
    """Within it, this thread works on the request ``id``; with "", on none."""
    token = _id.set(id)
    try:
        yield
    finally:
        _id.reset(token)


def keep_request_id(function: Callable[P, T]) -> Callable[P, T]:
    """The function, which works on the request of now wherever it is called: for threads, which begin without a request."""
    id = request_id()

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        with bound_request_id(id):
            return function(*args, **kwargs)

    return call


def attach_request_id(header: bytes = b"") -> bytes:
    """An attachment with the id of the request of now beside what ``header`` has, a message or nothing."""
    if not (id := request_id()):
        return header
    fields = _map_decoder.decode(header) if header else {}
    return msgspec.msgpack.encode({**fields, _FIELD: id})


def attached_request_id(attachment: bytes) -> str:
    """The id in an attachment; "" if there is none, or none that could be one."""
    if _FIELD_BYTES not in attachment:
        return ""
    try:
        id = _decoder.decode(attachment).request_id
    except (msgspec.DecodeError, ValueError, RecursionError):
        return ""
    return id if is_request_id(id) else ""


def has_no_message(attachment: bytes) -> bool:
    """Whether there is no attachment, or one that has nothing but the id of a request."""
    try:
        return not attachment or list(_map_decoder.decode(attachment)) == [_FIELD]
    except (msgspec.DecodeError, ValueError, RecursionError):
        return False


def add_request_id(logger: Any, method: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """Adds the id of the request of now to a log line. A processor of structlog."""
    if id := request_id():
        event.setdefault(_FIELD, id)
    return event
