"""Answers queries during a replay as the recorded services would have, with the newest message of each key."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial

from surveilnav import contract
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.contract import PERCEPTION_TEXT, Stream
from surveilnav.messages import Ack, FrameHeader, LoggedView, TextReply
from surveilnav.sensing.packing import picture_jpeg
from surveilnav.services.recorder.recorded import RecordedMessage

_REMEMBERED = (
    contract.CAMERA_INFO,
    contract.ROBOT_STATUS,
    contract.PERCEPTION_LOAD,
    contract.MAP_REVISION,
    contract.MISSION_STATUS,
    contract.MISSION_PLAN,
    contract.TRAFFIC,
)
_COMMANDS = (
    contract.MISSION_GOAL,
    contract.MISSION_CANCEL,
    contract.MISSION_PAUSE,
    contract.ROBOT_COMMAND,
    contract.ROBOT_HALT,
    contract.FORGET_PICTURES,
)
#: Which kind of node is there because it is in the recording, and by which id of its key.
_PRESENT = {contract.CAMERA_INFO: "camera", contract.ROBOT_STATUS: "robot", contract.PERCEPTION_LOAD: "perception"}


class LatestMessages:
    """The newest message of every key up to the present moment of the replay. Safe to use from several threads.

    ``prompt``: the text whose embedding is recorded.
    """

    def __init__(self, node: Node, prompt: str) -> None:
        self._node, self._prompt = node, prompt
        self._lock = threading.Lock()
        self._last: dict[Stream, dict[str, RecordedMessage]] = {stream: {} for stream in _REMEMBERED}
        self._pictures: dict[tuple[str, int], bytes] = {}
        self._meaning: TextReply | None = None
        self._present: set[tuple[str, str]] = set()
        for stream in _REMEMBERED:
            node.serve(stream, partial(self._told, stream))
        for stream in _COMMANDS:
            node.serve(stream, self._refuse)
        node.serve(contract.CAMERA_REQUEST, self._thumbnail)
        node.serve(PERCEPTION_TEXT, self._text)

    def record(self, heard: RecordedMessage) -> None:
        """Keeps a message as the newest of its key. The first message of a camera, robot or worker announces it on the bus."""
        with self._lock:
            if heard.stream in self._last:
                known, merge = self._last[heard.stream].get(heard.key), heard.stream.merge
                if known is not None and merge is not None:
                    heard = replace(heard, message=merge(known.message, heard.message))
                self._last[heard.stream][heard.key] = heard
            if heard.stream is PERCEPTION_TEXT:
                self._meaning = heard.message
        if (kind := _PRESENT.get(heard.stream)) is not None:
            self._announce(kind, next(v for k, v in heard.ids.items() if k not in ("building", "floor")))

    def record_picture(self, view: LoggedView, header: FrameHeader, payload: bytes) -> None:
        """Keeps the newest picture of a view. WireError: it can't be shown."""
        jpeg = picture_jpeg(header, payload)
        with self._lock:
            self._pictures[view.source, view.view] = jpeg

    def forget(self) -> None:
        """Drops all messages, for a jump back in time. Announced nodes stay: a page would take a moment's absence for a fault."""
        with self._lock:
            for last in self._last.values():
                last.clear()
            self._pictures.clear()

    def newest(self, *, regular: bool) -> list[RecordedMessage]:
        """What was last put of everything, or only of streams that have a rate, which grow stale while nothing happens."""
        with self._lock:
            return [
                h
                for stream, last in self._last.items()
                if "put" in stream.kind and (stream.rate_hz is not None or not regular)
                for h in last.values()
            ]

    def _announce(self, kind: str, id: str) -> None:
        if (kind, id) not in self._present:
            self._present.add((kind, id))
            self._node.announce(kind, id)

    def _told(self, stream: Stream, request: Request) -> list[Answer]:
        wanted = {k: v for k, v in request.ids.items() if k != "building"}
        with self._lock:
            rows = list(self._last[stream].values())
        found = [h for h in rows if all(h.ids.get(k) == v for k, v in wanted.items())]
        if not found and wanted:
            raise Refused("not_recorded", f"the recording tells nothing (yet) of {wanted}")
        return [Answer(h.message, h.payload, {k: v for k, v in h.ids.items() if k != "building"}) for h in found]

    def _refuse(self, _: Request) -> Answer:
        raise Refused("replay", "this is a recording: nothing in it can be told what to do")

    def _thumbnail(self, request: Request) -> Answer:
        if request.message.action != "thumbnail" or not request.message.views:
            self._refuse(request)
        key = f"camera/{request.ids['camera']}", request.message.views[0]
        with self._lock:
            picture = self._pictures.get(key)
        if picture is None:
            raise Refused("not_recorded", f"{key[0]} wasn't looked through (yet) in this direction")
        return Answer(Ack(stamp_ns=clock_ns()), picture)

    def _text(self, request: Request) -> Answer:
        if self._meaning is None or request.message.texts != [self._prompt]:
            raise Refused("not_recorded", "only what the mission looked for has a meaning in its recording")
        return Answer(self._meaning)
