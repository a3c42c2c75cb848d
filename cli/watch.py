"""``surveilnav watch``: one live screen; where nobody looks, a line for each event."""

from __future__ import annotations

import json
import queue
import signal
import threading
from collections import deque
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, results

if TYPE_CHECKING:
    from surveilnav.cli.watching.feed import Feed
    from surveilnav.client import ServerEvent
    from surveilnav.rest import Event

#: The gateway is asked often; one that hangs must not hold the screen up.
_TIMEOUT_S = 5.0
_DRAW_S = 0.25
_EVENTS = 200


def watch(url: Url = DEFAULT_URL, as_json: AsJson = False) -> None:
    """Watch the running system until Ctrl-C: missions and their reasons, robots, cameras, traffic, alerts.

    In a pipe or a file it is a line for each event; with --json an object a line: id, event, data.
    """
    from surveilnav.cli.watching.feed import Feed
    from surveilnav.client import Client

    live = results.is_terminal and not as_json
    gateway = Client(url, timeout_s=_TIMEOUT_S)
    feed, stopping = Feed(gateway, reads=live), threading.Event()
    # No exception: one that comes while something is being cleaned up is dropped, and the screen would stay.
    before = signal.signal(signal.SIGINT, lambda *_: stopping.set())
    try:
        if live:
            _show_live(feed, url, stopping)
        else:
            _print_events(feed, as_json, stopping)
    finally:
        signal.signal(signal.SIGINT, before)
        feed.close()
        gateway.close()


def _print_events(feed: Feed, as_json: bool, stopping: threading.Event) -> None:
    """A line an event, until it is to stop."""
    from surveilnav.cli.terminal import plain
    from surveilnav.cli.watching.lines import line_of

    while not stopping.is_set():
        event = _next(feed, 0.5)
        if event is None:
            continue
        if as_json:
            data = event.data.model_dump(mode="json", exclude_unset=True)
            print(json.dumps({"id": event.id, "event": event.kind, "data": data}), flush=True)
        else:
            print(plain(line_of(event)), flush=True)


def _show_live(feed: Feed, url: str, stopping: threading.Event) -> None:
    """The screen, drawn anew a few times a second."""
    from rich.console import Group
    from rich.live import Live

    from surveilnav.cli.watching.alerts import Alerts
    from surveilnav.cli.watching.lines import line_of
    from surveilnav.cli.watching.screen import screen

    events, alerts = deque[str](maxlen=_EVENTS), Alerts()
    with Live(console=results, screen=True, auto_refresh=False) as shown:
        while not stopping.wait(_DRAW_S):
            while (event := _next(feed, 0.0)) is not None:
                events.append(line_of(event))
            now, size, known = datetime.now(UTC), results.size, feed.known
            lines = screen(
                known, alerts.of(known, now), list(events), url=url, now=now, width=size.width, height=size.height
            )
            shown.update(Group(*lines), refresh=True)


def _next(feed: Feed, wait_s: float) -> ServerEvent[Event] | None:
    """The next event, if one comes in time. GatewayError: it never began."""
    try:
        event = feed.events.get(timeout=wait_s) if wait_s else feed.events.get_nowait()
    except queue.Empty:
        return None
    if isinstance(event, Exception):
        raise event
    return event
