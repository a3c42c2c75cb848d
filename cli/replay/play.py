"""``surveilnav replay FILE``: router and gateway, and a recording in the place of everybody else."""

from __future__ import annotations

import re
import signal
import tempfile
import threading
import time
from pathlib import Path

import msgspec
from rich.console import Console

from surveilnav.bus import Node, Publisher
from surveilnav.bus.router import free_port
from surveilnav.cli.replay.check import missing_in_words
from surveilnav.cli.replay.clock import ReplayClock
from surveilnav.cli.replay.control import ReplayControls
from surveilnav.cli.replay.latest_messages import LatestMessages
from surveilnav.cli.replay.maps import ReplayedMaps
from surveilnav.cli.stack import Stack
from surveilnav.contract import CAMERA_FRAME, ID_PATTERN, ROBOT_OBSERVATION, VIEW_LOG, Stream
from surveilnav.errors import WireError
from surveilnav.messages import LoggedView
from surveilnav.services.recorder.core.pictures import decode_header
from surveilnav.services.recorder.reading import RecordingError
from surveilnav.services.recorder.recorded import (
    RecordedDamage,
    RecordedItem,
    RecordedMaps,
    RecordedMessage,
    RecordedStart,
    read_recording,
)

_REPEAT_S = 1.0
_READY_S = 60.0


class Player:
    """Says and does again what a recording tells."""

    def __init__(self, node: Node, folder: Path, facts: dict[str, str]) -> None:
        self._node = node
        self._latest = LatestMessages(node, facts.get("prompt", ""))
        self._maps = ReplayedMaps(node, folder)
        self._publishers: dict[str, Publisher] = {}
        for kind in ("fusion", "planner"):
            node.announce(kind, kind)

    def tell(self, found: RecordedItem, *, quietly: bool = False) -> None:
        """One thing that the recording tells. ``quietly``: it is taken in, but nobody hears of it."""
        match found:
            case RecordedMaps():
                self._maps.begin(found)
            case RecordedMessage(stream=stream) if stream is VIEW_LOG:
                self._view(found.message, found.payload, quietly)
            case RecordedMessage():
                self._latest.record(found)
                if "put" in found.stream.kind and not quietly:
                    self._put(found.stream, found.ids, found.message)
            case _:
                pass

    def forget(self) -> None:
        """Begins anew: nothing was told yet."""
        self._latest.forget()
        self._maps.forget()

    def tell_again(self, *, regular: bool) -> None:
        """Says what was last said of everything, or only of what is said ``regular``ly and would grow stale."""
        for heard in self._latest.newest(regular=regular):
            self._put(heard.stream, heard.ids, heard.message)

    def close(self) -> None:
        self._maps.close()

    def _view(self, view: LoggedView, payload: bytes, quietly: bool) -> None:
        """A view is put as its camera or robot did, and goes into the maps."""
        try:
            if payload:
                header = decode_header(view)
                kind, _, name = view.source.partition("/")
                ids = (
                    {kind: name} if kind == "robot" else {"camera": name, "floor": header.floor, "view": str(view.view)}
                )
                if not quietly:
                    self._put(ROBOT_OBSERVATION if kind == "robot" else CAMERA_FRAME, ids, header, payload)
                self._latest.record_picture(view, header, payload)
            self._maps.integrate(view, payload)
        except (WireError, msgspec.DecodeError, ValueError) as error:
            raise RecordingError(f"view {view.number} can't be read: {error}") from error

    def _put(self, stream: Stream, ids: dict[str, str], message: msgspec.Struct, payload: bytes = b"") -> None:
        ids = {k: v for k, v in ids.items() if k != "building"}
        key = self._node.key(stream, **ids)
        if key not in self._publishers:
            self._publishers[key] = self._node.publisher(stream, **ids)
        if not payload or self._publishers[key].matched:
            self._publishers[key].put(message, payload)  # type: ignore[arg-type]


def run_replay(console: Console, path: Path, *, speed: float, port: int) -> None:
    """Shows a recording on the page and by REST until Ctrl-C.

    Raises:
        RecordingError: it can't be read.
    """
    facts = _facts(path)
    first_ns, last_ns = _span_ns(path)
    if missing := missing_in_words(path):
        console.print(missing, markup=False, soft_wrap=True)
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    with tempfile.TemporaryDirectory(prefix="surveilnav-replay-") as name:
        folder = Path(name)
        variables = {
            "SURVEILNAV_BUS__ROUTER": f"tcp/127.0.0.1:{free_port()}",
            "SURVEILNAV_BUS__BUILDING": facts["building"],
            "SURVEILNAV_GATEWAY__PORT": str(port),
        }
        with (
            Stack(variables, folder / "logs", gateway=True, searches=False) as stack,
            Node("replay", "replay", stack.bus) as node,
        ):
            stack.wait_ready(node, _READY_S)
            console.print(
                f"ready: http://127.0.0.1:{port}/  ({facts['mission']}: {facts.get('target')!r} in {facts['building']})"
            )
            player = Player(node, folder, facts)
            controls = ReplayControls(
                node,
                ReplayClock((last_ns - first_ns) / 1e9, speed),
                facts["mission"],
                facts.get("target", ""),
                first_ns,
            )
            try:
                _Playing(player, controls, path, first_ns).run(console, stopping, stack)
            finally:
                player.close()
    console.print("stopped")


class _Playing:
    """Tells a recording at its clock's pace, from wherever it is taken to."""

    def __init__(self, player: Player, controls: ReplayControls, path: Path, first_ns: int) -> None:
        self._player, self._controls, self._path, self._first_ns = player, controls, path, first_ns
        self._rest = read_recording(path)
        self._next: RecordedItem | None = next(self._rest, None)
        self._told_s = 0.0  # the moment of what was told last

    def run(self, console: Console, stopping: threading.Event, stack: Stack) -> None:
        """Until ``stopping`` is set. What would grow stale is repeated meanwhile."""
        said_so, repeated_s = False, time.monotonic()
        while not stopping.is_set():
            if (jump := self._controls.take_jump()) is not None:
                self._go_to(jump, stopping)
                self._controls.tell()
            wait_s = float("inf") if self._next is None else self._controls.wait_s(self._moment(self._next))
            if wait_s <= 0 and self._next is not None:
                self._tell_next()
            if self._next is None and not said_so:
                console.print("the recording is over; its end stays on the page    stop: Ctrl-C")
                said_so = True
            if time.monotonic() - repeated_s >= _REPEAT_S:
                repeated_s = time.monotonic()
                stack.check()
                self._controls.tell()
                self._player.tell_again(regular=True)
            if wait_s > 0:
                self._controls.changed.wait(min(wait_s, _REPEAT_S / 2))

    def _go_to(self, moment_s: float, stopping: threading.Event) -> None:
        """Takes in all until a moment without a word, from the start if it is past, then says how things are."""
        if moment_s < self._told_s:
            self._player.forget()
            self._rest, self._told_s = read_recording(self._path), 0.0
            self._next = next(self._rest, None)
        self._controls.begin_anew()  # who knows the future forgets it, and nobody here tells of it any more
        while self._next is not None and self._moment(self._next) <= moment_s and not stopping.is_set():
            self._tell_next(quietly=True)
        self._told_s = moment_s
        self._player.tell_again(regular=False)

    def _moment(self, found: RecordedItem) -> float:
        """When something happened [s from the start]; what has no time of its own, when the last thing did."""
        return (found.log_ns - self._first_ns) / 1e9 if isinstance(found, RecordedMessage) else self._told_s

    def _tell_next(self, *, quietly: bool = False) -> None:
        assert self._next is not None, "asked for before"
        self._told_s = max(self._told_s, self._moment(self._next))
        self._player.tell(self._next, quietly=quietly)
        self._next = next(self._rest, None)


def _span_ns(path: Path) -> tuple[int, int]:
    """When the first and the last thing in a recording happened [ns since the epoch]."""
    stamps = [found.log_ns for found in read_recording(path) if isinstance(found, RecordedMessage)]
    return (min(stamps), max(stamps)) if stamps else (0, 0)


def _facts(path: Path) -> dict[str, str]:
    """What the recording is of. RecordingError: it doesn't say."""
    first = next((found for found in read_recording(path) if not isinstance(found, RecordedDamage)), None)
    if not isinstance(first, RecordedStart) or not {"building", "mission"} <= set(first.facts):
        raise RecordingError(f"{path} doesn't begin with the facts of a mission")
    if not re.fullmatch(ID_PATTERN, first.facts["building"]):
        raise RecordingError(f"expected the name of a building, got {first.facts['building']!r:.80}")
    return first.facts
