"""``surveilnav watch``: one live screen; where nobody looks, a line for each event."""

from __future__ import annotations

import json
import queue
import time
from collections import deque
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from cli.options import DEFAULT_URL, AsJson, Url, results

if TYPE_CHECKING:
    from cli.watching.feed import Feed
    from surveilnav.client.events import Told

#: The gateway is asked often; one that hangs must not hold the screen up.
_TIMEOUT_S = 5.0
_DRAW_S = 0.25
_EVENTS = 200


def watch(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Watch the running system: missions and why they go where, robots, cameras, traffic, alerts. Ctrl-C ends it.

    In a pipe or a file it is a line for each event; with --json an object a line: id, event, data.
    """
    from cli.watching.feed import Feed
    from surveilnav.client import Client

    live = results.is_terminal and not as_json
    gateway = Client(url, timeout_s=_TIMEOUT_S)
    feed = Feed(gateway, reads=live)
    try:
        if live:
            _show_live(feed, url)
        else:
            _print_events(feed, as_json)
    except KeyboardInterrupt:
        pass  # how it is meant to end
    finally:
        feed.close()
        gateway.close()


def _print_events(feed: Feed, as_json: bool) -> None:
    """A line an event, for ever."""
    from cli.terminal import plain
    from cli.watching.lines import line_of

    while True:
        told = _next(feed, 0.5)
        if told is not None:
            what = (
                json.dumps({"id": told.id, "event": told.kind, "data": told.data}) if as_json else plain(line_of(told))
            )
            print(what, flush=True)


def _show_live(feed: Feed, url: str) -> None:
    """The screen, drawn anew a few times a second."""
    from rich.console import Group
    from rich.live import Live

    from cli.watching.alerts import Alerts
    from cli.watching.lines import line_of
    from cli.watching.screen import screen

    events, alerts = deque[str](maxlen=_EVENTS), Alerts()
    with Live(console=results, screen=True, auto_refresh=False) as shown:
        while True:
            while (told := _next(feed, 0.0)) is not None:
                events.append(line_of(told))
            now, size, known = datetime.now(UTC), results.size, feed.known
            lines = screen(
                known, alerts.of(known, now), list(events), url=url, now=now, width=size.width, height=size.height
            )  # fmt: skip
            shown.update(Group(*lines), refresh=True)
            time.sleep(_DRAW_S)


def _next(feed: Feed, wait_s: float) -> Told | None:
    """The next event, if one comes in time. GatewayError: it never began."""
    try:
        told = feed.events.get(timeout=wait_s) if wait_s else feed.events.get_nowait()
    except queue.Empty:
        return None
    if isinstance(told, Exception):
        raise told
    return told
