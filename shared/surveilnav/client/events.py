"""Server-Sent Events, read so that a connection that breaks costs nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import cast

import httpx

from surveilnav.client.resources import Event

#: The gateway says something every 15 s: after so long without a byte the connection is dead.
_SILENT_S = 45.0
_AGAIN_S = 1.0


@dataclass(frozen=True, slots=True)
class Told:
    """One event. ``kind``: mission, object, camera, robot, service or reset, whose data is ``why`` and ``do`` alone."""

    id: str
    kind: str
    data: Event


def blocks(lines: Iterator[str]) -> Iterator[dict[str, str]]:
    """The fields of each block that has ended; what a cut leaves unfinished isn't one."""
    fields: dict[str, str] = {}
    for line in lines:
        if not line:
            if fields:
                yield fields
            fields = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(":")
            fields[name] = value.removeprefix(" ")


def follow(
    http: httpx.Client,
    path: str,
    last_id: str,
    refusal: Callable[[httpx.Response], Exception],
    unreachable: Callable[[Exception], Exception],
) -> Iterator[Told]:
    """Events after ``last_id``, over as many connections as it takes. Raises what ``refusal`` makes of an error, and what
    ``unreachable`` does if not even the first connection can be had."""
    connected = False
    while True:
        headers = {"Last-Event-ID": last_id} if last_id else {}
        try:
            timeout = httpx.Timeout(_SILENT_S, connect=10.0)
            with http.stream("GET", path, headers=headers, timeout=timeout) as answer:
                if answer.is_error:
                    answer.read()
                    raise refusal(answer)
                connected = True
                for fields in blocks(answer.iter_lines()):
                    last_id = fields.get("id", last_id)
                    if "event" in fields:
                        yield Told(last_id, fields["event"], cast("Event", json.loads(fields.get("data", "{}"))))
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            if not connected:
                raise unreachable(error) from error
        time.sleep(_AGAIN_S)
