"""Keeps what is known up to date: one thread follows the events, another reads what they are about."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from datetime import UTC, datetime

from surveilnav.cli.watching.system_state import SystemState, read_moving, read_rest
from surveilnav.client import Client, ServerEvent
from surveilnav.errors import GatewayError
from surveilnav.rest import Event

#: So often what moves is read anew, and all else where no event calls for it.
_MOVING_S, _REST_S = 1.0, 3.0
_AGAIN_S = 1.0


class Feed:
    """``events`` has what was told, or the mistake by which it never began. ``known`` is replaced whole.

    A gateway that goes away is waited for; what happened meanwhile comes when it is back.
    """

    def __init__(self, gateway: Client, *, reads: bool = True) -> None:
        self.events: queue.Queue[ServerEvent[Event] | GatewayError] = queue.Queue()
        self.known = SystemState()
        self._gateway, self._ended, self._news = gateway, threading.Event(), threading.Event()
        threads = [self._follow, *([self._read] if reads else [])]
        for run in threads:
            threading.Thread(target=run, daemon=True).start()

    def close(self) -> None:
        """Ends the reading; the thread of the events ends with the client."""
        self._ended.set()
        self._news.set()

    def _follow(self) -> None:
        last_id, began = "", False
        while not self._ended.is_set():
            try:
                for event in self._gateway.events(last_id):
                    last_id, began = event.id, True
                    self.events.put(event)
                    self._news.set()
            except GatewayError as error:  # a proxy says so while the gateway starts, or it has too many streams
                if not began:
                    self.events.put(error)
                    return
                time.sleep(_AGAIN_S)
            except RuntimeError:  # the client was closed
                return

    def _read(self) -> None:
        read_s = 0.0
        while not self._ended.is_set():
            now_s, called = time.monotonic(), self._news.is_set()
            self._news.clear()
            try:
                known = read_moving(self.known, self._gateway)
                if called or now_s - read_s >= _REST_S:
                    known = read_rest(known, self._gateway, now_s - read_s if read_s else 0.0)
                    read_s = now_s
                self.known = known
            except GatewayError:
                if not self.known.lost:
                    self.known = replace(self.known, lost=datetime.now(UTC))
            except RuntimeError:  # the client was closed
                return
            self._news.wait(_MOVING_S)
