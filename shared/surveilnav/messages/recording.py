"""Recordings: what the maps were made of, as fusion tells it, and the files that a recorder keeps."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message


class LoggedView(Message, frozen=True, kw_only=True):
    """A view as fusion logged it before its maps took it: whoever has all of them can make the same maps again.

    ``number``: in the log, from 1 on; 0: there is none yet after the one asked for. ``newest``: the last that the maps took.
    ``header``: of the frame or observation, as MessagePack; ``reply``: what perception answered (an ``InferReply``), empty
    where nobody looked. ``fault``: why it was of no use, with neither. The payload is the picture. ``digest``: of pose, picture
    and what looked at it.
    """

    number: int
    newest: int
    source: str = ""
    view: int = 0
    header: bytes = b""
    reply: bytes = b""
    digest: bytes = b""
    fault: str = ""


class MapSnapshot(Message, frozen=True, kw_only=True):
    """The maps after view ``number`` of the log, piece by piece: the payload is what lies at ``offset`` of ``n_bytes``.

    ``digest``: of the maps alone, in hex: the same for the same maps. ``config``: what fusion makes them with, as JSON.
    ``revision``: how many views they hold.
    """

    number: int
    revision: int
    digest: str
    config: str = ""
    offset: int = 0
    n_bytes: int = 0


class RecorderStatus(Message, frozen=True, kw_only=True):
    """How a recorder is. ``recording``: the ids of the files that are being written. ``problem``: why something isn't recorded
    now; empty while all is. ``dropped``: messages that the disk was too slow for, since the recorder started. ``n_bytes``: of
    all its files; ``free_bytes``: left on its disk.
    """

    recorder: str
    recording: list[str] = []
    problem: str = ""
    dropped: int = 0
    n_bytes: int = 0
    free_bytes: int = 0


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    """One file. ``state``: "recording" while it is written; "interrupted": its end is missing, it can be read so far.
    ``cameras``: those whose pictures it shows; None: nobody knows, as it isn't complete."""

    id: str
    mission: str
    state: Literal["recording", "complete", "interrupted"]
    n_bytes: int
    started_ns: int
    changed_ns: int
    target: str = ""
    cameras: list[str] | None = None


class RecordingList(Message, frozen=True, kw_only=True):
    """The files of a recorder, newest first."""

    recorder: str
    recordings: list[Recording]


class RecordingPart(Message, frozen=True, kw_only=True):
    """A stretch of a file: asked for, and (with the bytes as payload) answered. ``total_bytes``: of the file, in an answer."""

    id: str
    offset: int = 0
    n_bytes: int = 0
    total_bytes: int = 0


class RecordingRemoval(Message, frozen=True, kw_only=True):
    """Asks a recorder to delete a file for good; one that is being written can't be."""

    id: str


#: How many times as fast as it happened a recording may be shown.
SLOWEST_REPLAY, FASTEST_REPLAY = 0.01, 1000.0


class ReplayStatus(Message, frozen=True, kw_only=True):
    """A recording that is shown again. ``at_s`` of ``duration_s`` was told; ``speed``: so many times as fast as it happened;
    ``began_ns``: when it did. ``jumps``: how often it was taken to another moment: what was heard before may lie in its future.
    """

    player: str
    mission: str
    target: str
    began_ns: int
    at_s: float
    duration_s: float
    speed: float
    playing: bool
    jumps: int


class ReplayControl(Message, frozen=True, kw_only=True):
    """What a replay should do; None: as it is. ``at_s``: where to go on from; ``speed``: see ``ReplayStatus``."""

    at_s: float | None = None
    speed: float | None = None
    playing: bool | None = None
