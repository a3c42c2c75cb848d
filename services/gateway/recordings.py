"""Recordings: listed, handed out, deleted. Their recorder has the files; the gateway asks for them over the bus."""

from __future__ import annotations

from collections.abc import Iterator

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import RecordingPart, RecordingRemoval
from surveilnav.services.gateway.asking import absent, ask
from surveilnav.services.gateway.core.cursors import Place, page_after
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import GrowingItems, Recorder, Recording
from surveilnav.services.gateway.state import BuildingState

_AGAIN = 2
_PART_BYTES = 1 << 20


class Recordings:
    """The recordings of all recorders that are there."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node

    def recorders(self) -> list[Recorder]:
        """Every recorder that was ever heard of."""
        alive, told = self._node.alive("recorder"), self._state.recorders
        return [
            Recorder.from_status(row.message, row.received_ns, id not in alive or told.old(row))
            for id, row in told.newest("recorder").items()
        ]

    def page(self, mission: str, cursor: str | None, offset: int, limit: int) -> GrowingItems[Recording]:
        """At most ``limit``, newest first, after a cursor or from ``offset``; of one mission, if it is named."""
        rows = sorted((r for r in self._all() if mission in ("", r.mission)), key=_place)
        page, following = page_after(rows, _place, cursor, offset, limit)
        return GrowingItems(items=page, total=len(rows), next=following)

    def one(self, id: str) -> Recording:
        """One recording; 404 if nobody has it."""
        for recording in self._all():
            if recording.id == id:
                return recording
        raise Problem(
            404, "unknown_recording", f"no recording {id!r}: it may have been the oldest when room was needed"
        )

    def shown_by(self, recording: Recording) -> list[str]:
        """The cameras whose pictures it may show: all that were heard of, where it doesn't tell."""
        known = self._state.cameras.newest("camera")
        return sorted(known) if recording.cameras is None else recording.cameras

    def delete(self, id: str) -> None:
        """Has it deleted for good; one that is being written isn't (409)."""
        recorder = self.one(id).recorder
        removal = RecordingRemoval(stamp_ns=clock_ns(), id=id)
        ask(self._node, f"recorder {recorder}", contract.RECORDING_DELETE, removal, recorder=recorder)

    def parts(self, recording: Recording, first: int, after: int) -> Iterator[bytes]:
        """Its bytes from ``first`` to before ``after``, piece by piece: no more is held than one of them."""
        while first < after:
            wanted = RecordingPart(
                stamp_ns=clock_ns(), id=recording.id, offset=first, n_bytes=min(_PART_BYTES, after - first)
            )
            who = f"recorder {recording.recorder}"
            data = self._read(who, wanted, recording.recorder)
            if not 0 < len(data) <= wanted.n_bytes:
                raise Problem(
                    502, "bad_part", f"{who} answered with {len(data)} bytes where {wanted.n_bytes} were asked for"
                )
            first += len(data)
            yield data

    def _read(self, who: str, wanted: RecordingPart, recorder: str) -> bytes:
        """A stretch of a file. Where a link is full its answer is left out: then it is asked for again."""
        for _ in range(_AGAIN):
            try:
                return ask(self._node, who, contract.RECORDING_READ, wanted, recorder=recorder).payload
            except Problem as problem:
                if problem.status != 504:
                    raise
        return ask(self._node, who, contract.RECORDING_READ, wanted, recorder=recorder).payload

    def _all(self) -> list[Recording]:
        recorders = sorted(self._node.alive("recorder"))
        if not recorders:
            raise absent("recorder")
        return [
            Recording.of(kept, recorder, self._state.root)
            for recorder in recorders
            for kept in ask(
                self._node, f"recorder {recorder}", contract.RECORDINGS, recorder=recorder
            ).message.recordings
        ]


def _place(recording: Recording) -> Place:
    """Newest first."""
    started_ns = int(recording.started.timestamp() * 1000) if recording.started else 0
    return -started_ns, recording.mission
