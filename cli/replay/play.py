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

from cli.replay.maps import MapsAgain
from cli.replay.memory import Memory
from cli.replay.recorded import Begin, Heard, Maps, Told, told
from cli.stack import Stack
from services.recorder.core.pictures import header_of
from services.recorder.reading import RecordingError
from surveilnav.bus import Node, Publisher
from surveilnav.bus.router import free_port
from surveilnav.contract import CAMERA_FRAME, ID_PATTERN, ROBOT_OBSERVATION, VIEW_LOG, Stream
from surveilnav.errors import WireError
from surveilnav.messages import LoggedView

_REPEAT_S = 1.0
_READY_S = 60.0


class Player:
    """Says and does again what a recording tells."""

    def __init__(self, node: Node, folder: Path, facts: dict[str, str]) -> None:
        self._node = node
        self._memory = Memory(node, facts.get("prompt", ""))
        self._maps = MapsAgain(node, folder)
        self._publishers: dict[str, Publisher] = {}
        for kind in ("fusion", "planner"):
            node.announce(kind, kind)

    def tell(self, found: Told) -> None:
        """One thing that the recording tells."""
        match found:
            case Maps():
                self._maps.begin(found)
            case Heard(stream=stream) if stream is VIEW_LOG:
                self._view(found.message, found.payload)
            case Heard():
                self._memory.note(found)
                if "put" in found.stream.kind:
                    self._put(found.stream, found.ids, found.message)
            case _:
                pass

    def repeat(self) -> None:
        """Says again what would grow stale."""
        for heard in self._memory.repeated():
            self._put(heard.stream, heard.ids, heard.message)

    def close(self) -> None:
        """Closes the maps."""
        self._maps.close()

    def _view(self, view: LoggedView, payload: bytes) -> None:
        """A view is put as its camera or robot did, and goes into the maps."""
        try:
            if payload:
                header = header_of(view)
                kind, _, name = view.source.partition("/")
                ids = (
                    {kind: name} if kind == "robot" else {"camera": name, "floor": header.floor, "view": str(view.view)}
                )
                self._put(ROBOT_OBSERVATION if kind == "robot" else CAMERA_FRAME, ids, header, payload)
                self._memory.note_picture(view, header, payload)
            self._maps.take(view, payload)
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
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    with tempfile.TemporaryDirectory(prefix="surveilnav-replay-") as name:
        folder = Path(name)
        variables = {
            "SURVEILNAV_BUS__ROUTER": f"tcp/127.0.0.1:{free_port()}", "SURVEILNAV_BUS__BUILDING": facts["building"],
            "SURVEILNAV_GATEWAY__PORT": str(port),
        }  # fmt: skip
        with (
            Stack(variables, folder / "logs", gateway=True, searches=False) as stack,
            Node("replay", "replay", stack.bus) as node,
        ):
            stack.wait_ready(node, _READY_S)
            console.print(
                f"ready: http://127.0.0.1:{port}/  ({facts['mission']}: {facts.get('target')!r} in {facts['building']})"
            )
            player = Player(node, folder, facts)
            try:
                _play(player, path, speed, stopping, stack)
                if not stopping.is_set():
                    console.print("the recording is over; its end stays on the page    stop: Ctrl-C")
                while not stopping.wait(_REPEAT_S):
                    stack.check()
                    player.repeat()
            finally:
                player.close()
    console.print("stopped")


def _play(player: Player, path: Path, speed: float, stopping: threading.Event, stack: Stack) -> None:
    """Tells the recording at its pace, ``speed`` times as fast."""
    began_s, first_ns = time.monotonic(), 0
    repeated_s = began_s
    for found in told(path):
        if isinstance(found, Heard):
            first_ns = first_ns or found.log_ns
            due_s = began_s + (found.log_ns - first_ns) / 1e9 / speed
            while (left_s := due_s - time.monotonic()) > 0 and not stopping.wait(min(left_s, _REPEAT_S)):
                stack.check()
                if time.monotonic() - repeated_s >= _REPEAT_S and left_s > _REPEAT_S:
                    repeated_s = time.monotonic()
                    player.repeat()
        if stopping.is_set():
            return
        player.tell(found)


def _facts(path: Path) -> dict[str, str]:
    """What the recording is of. RecordingError: it doesn't say."""
    first = next(told(path))
    if not isinstance(first, Begin) or not {"building", "mission"} <= set(first.facts):
        raise RecordingError(f"{path} doesn't begin with the facts of a mission")
    if not re.fullmatch(ID_PATTERN, first.facts["building"]):
        raise RecordingError(f"expected the name of a building, got {first.facts['building']!r:.80}")
    return first.facts
