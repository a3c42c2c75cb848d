"""Messages for recording and replay: fusion's log of views, the recorder's files, the state of a replay."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message

#: The id of a building's only fusion service. Recordings of earlier releases, which had no other, don't name it.
ONLY_FUSION = "fusion"


class LoggedView(Message, frozen=True, kw_only=True):
    """An entry of fusion's log of views, from which the maps can be rebuilt exactly. The payload is the picture.

    Attributes:
        number: position in the log, from 1; 0: there is no later entry than the requested one yet.
        newest: number of the newest view in the maps.
        header: the frame's or observation's header as MessagePack.
        reply: perception's ``InferReply`` as MessagePack; empty if the view wasn't given to perception.
        digest: hash of pose, picture and perception's models.
        fault: why the view was refused; then header and reply are empty.
        removals: how many removals (``RemoveFromMaps``) the maps reflect. When it changes, earlier views don't give the maps any
            more.
        fusion: the fusion service whose log this is.
    """

    number: int
    newest: int
    source: str = ""
    view: int = 0
    header: bytes = b""
    reply: bytes = b""
    digest: bytes = b""
    fault: str = ""
    removals: int = 0
    fusion: str = ONLY_FUSION


class MapSnapshot(Message, frozen=True, kw_only=True):
    """The maps after view ``number`` of the log, in pieces: the payload is the piece at ``offset`` of ``n_bytes``.

    Attributes:
        revision: number of views in the maps.
        digest: hash of the maps in hex, equal for equal maps.
        config: fusion's settings for the maps as JSON.
        removals, fusion: as in ``LoggedView``.
    """

    number: int
    revision: int
    digest: str
    config: str = ""
    offset: int = 0
    n_bytes: int = 0
    removals: int = 0
    fusion: str = ONLY_FUSION


class RecorderStatus(Message, frozen=True, kw_only=True):
    """State of a recorder.

    Attributes:
        recording: ids of the files that are being written.
        problem: why something isn't being recorded; empty if everything is.
        dropped: number of messages lost since the recorder started because the disk was too slow.
        n_bytes: size of all its files.
        free_bytes: free space on its disk.
    """

    recorder: str
    recording: list[str] = []
    problem: str = ""
    dropped: int = 0
    n_bytes: int = 0
    free_bytes: int = 0


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    """One file of a recorder.

    Attributes:
        state: "recording": it is being written; "interrupted": its end is missing, but what there is can be read.
        started_ns, changed_ns: times of the recording's start and of the last write.
        cameras: the cameras whose pictures it contains; None: unknown, because it isn't complete.
    """

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
    """A part of a file, in the query and, with its bytes as payload, in the answer. ``total_bytes``: the file's size."""

    id: str
    offset: int = 0
    n_bytes: int = 0
    total_bytes: int = 0


class RecordingRemoval(Message, frozen=True, kw_only=True):
    """Asks a recorder to delete a file for good. A file that is being written can't be deleted."""

    id: str


#: Limits of a replay's speed; 1 is real time.
SLOWEST_REPLAY, FASTEST_REPLAY = 0.01, 1000.0


class ReplayStatus(Message, frozen=True, kw_only=True):
    """State of a replay.

    Attributes:
        began_ns: when the recording began.
        at_s: present position in the recording, of ``duration_s``.
        speed: 1 is real time.
        jumps: number of jumps so far. After a jump, messages received before it may lie in the replay's future.
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
    """Controls a replay; fields that are None stay as they are. ``at_s``: position to jump to; ``speed``: 1 is real time."""

    at_s: float | None = None
    speed: float | None = None
    playing: bool | None = None
