"""Server-Sent Events, read so that a connection that breaks costs nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import httpx
from httpx_sse import SSEError, connect_sse

T = TypeVar("T")
#: The gateway sends something every 15 s. After this time without a byte the connection is dead.
_SILENT_S = 45.0
_RECONNECT_S = 1.0


@dataclass(frozen=True, slots=True)
class ServerEvent(Generic[T]):
    """One event of a stream.

    Attributes:
        id: to go on from, after this event.
        kind: what the event is about, such as mission, object, camera, robot or service; or reset, where the reader has to
            begin anew: its data says ``why``, and what to ``do``.
        data: of ``events()`` a ``rest.Event``, of ``live()`` a ``rest.LiveState``, of ``tiles()`` a ``rest.TileState``.
    """

    id: str
    kind: str
    data: T


def follow(
    http: httpx.Client,
    path: str,
    last_id: str,
    parse: Callable[[str, dict[str, Any]], T],
    refusal: Callable[[httpx.Response], Exception],
    unreachable: Callable[[Exception], Exception],
) -> Iterator[ServerEvent[T]]:
    """The events after ``last_id``, without end, over as many connections as it takes.

    Args:
        last_id: the id of the last event that was received before; "" for none.
        parse: makes an event's data of its kind and JSON.
        refusal: makes an exception of an error answer.
        unreachable: makes an exception of what happened where not even the first connection succeeds, or what answers sends
            no events.
    """
    connected = False
    timeout = httpx.Timeout(_SILENT_S, connect=10.0)
    while True:
        headers = {"Last-Event-ID": last_id} if last_id else {}
        try:
            with connect_sse(http, "GET", path, headers=headers, timeout=timeout) as source:
                if source.response.is_error:
                    source.response.read()
                    raise refusal(source.response)
                connected = True
                for event in source.iter_sse():
                    last_id = event.id or last_id  # "" before the first id of this connection
                    if event.data:  # what has an id alone tells how far the stream is
                        yield ServerEvent(last_id, event.event, parse(event.event, json.loads(event.data)))
        except SSEError as error:
            raise unreachable(error) from error
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            if not connected:
                raise unreachable(error) from error
        time.sleep(_RECONNECT_S)
