"""Whether a recording makes the same maps again, to the bit."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
from pydantic import ValidationError
from zstandard import ZstdError, frame_content_size

from surveilnav.contract import VIEW_LOG
from surveilnav.errors import WireError
from surveilnav.messages import LoggedView
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.snapshot import SnapshotError, digest, freeze, thaw, unpack
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.fusion.map_log.recovery import perceived_from_entry
from surveilnav.services.fusion.map_log.store import Entry
from surveilnav.services.recorder.core.facts import fact_name
from surveilnav.services.recorder.reading import RecordingError
from surveilnav.services.recorder.recorded import (
    RecordedDamage,
    RecordedEnd,
    RecordedMaps,
    RecordedMessage,
    read_recording,
)

_MOST_MAPS_BYTES = 2 << 30
_MAX_SPANS = 5  # that are named of what is missing


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of making a recording's maps again: the digest of the recorded maps and of the maps made now.

    Attributes:
        recorded: digest of fusion's maps when the mission ended, of several fusion services one after the other; "" if the
            recording doesn't have it.
        replayed: digest of the maps that were made now from the recording.
        views: how many of the recorded views were integrated into the maps for this.
        began_with: how many views were in the maps with which the recording begins (its snapshot).
        ended: whether the recording is complete; False: it was cut off before its end.
        missing: what of the file is damaged, in words; "" if nothing is.
    """

    recorded: str
    replayed: str
    views: int
    began_with: int
    ended: bool
    missing: str = ""

    @property
    def same(self) -> bool:
        """Whether both digests are equal, that is, the maps are the same to the bit."""
        return self.recorded == self.replayed

    def in_words(self) -> str:
        """What was found, with both digests."""
        unknown = (
            "fusion didn't tell when the mission ended" if self.ended else "the recording was cut off before its end"
        )
        recorded = self.recorded or f"unknown: {unknown}"
        verdict = "the same maps, bit for bit" if self.same else "NOT the same maps"
        if not self.recorded:
            verdict = "nothing to compare with"
        found = f"recorded: {recorded}\nreplayed: {self.replayed}\n{verdict}: {self.views} views after maps of {self.began_with}"
        return f"{found}\n{self.missing}" if self.missing else found

    def as_dict(self) -> dict[str, Any]:
        return {**asdict(self), "same": self.same}


class _RemadeMaps:
    """The maps of a fusion service, made again. ``views``: how many went in; ``began_with``: how many the snapshot had."""

    def __init__(self, joint: JointMap) -> None:
        self.joint, self.began_with, self.views = joint, joint.revision, 0

    def integrate(self, view: LoggedView, payload: bytes) -> None:
        """Integrates a view as fusion did. One that the maps refuse they refused then, too."""
        try:
            perceived = perceived_from_entry(entry_of(view, payload))
            if perceived.view is not None and self.joint.accept(perceived.view, perceived.perception) is not None:
                self.views += 1
        except ViewError:
            pass
        except (WireError, msgspec.DecodeError) as error:
            raise RecordingError(f"view {view.number} can't be read: {error}") from error


def check(path: Path) -> Outcome:
    """Makes the maps of a recording again, from the snapshot and the views in it.

    Raises:
        RecordingError: it can't be read, or holds no maps.
    """
    made: dict[str, _RemadeMaps] = {}  # by fusion service
    facts: dict[str, str] | None = None
    for found in read_recording(path):
        match found:
            case RecordedMaps():
                made[found.fusion] = _RemadeMaps(maps_of(found))
            case RecordedMessage(stream=stream, message=message, payload=payload) if (
                stream is VIEW_LOG and message.fusion in made
            ):
                made[message.fusion].integrate(message, payload)
            case RecordedEnd():
                facts = found.facts
    if not made:
        raise RecordingError(f"{path} holds no maps: fusion kept no log (SURVEILNAV_FUSION__STORE), or wasn't there")
    recorded = [(facts or {}).get(fact_name("digest", fusion), "") for fusion in sorted(made)]
    return Outcome(
        recorded=" ".join(recorded) if all(recorded) else "",
        replayed=" ".join(digest(freeze(made[fusion].joint)) for fusion in sorted(made)),
        views=sum(maps.views for maps in made.values()),
        began_with=sum(maps.began_with for maps in made.values()),
        ended=facts is not None,
        missing=missing_in_words(path),
    )


def missing_in_words(path: Path) -> str:
    """Which parts of a recording can't be read because the file is damaged; "" if all can. Raises RecordingError."""
    damages = [found for found in read_recording(path) if isinstance(found, RecordedDamage)]
    if not damages:
        return ""
    spans = [
        f"{datetime.fromtimestamp(d.start_ns / 1e9):%H:%M:%S} to {datetime.fromtimestamp(d.end_ns / 1e9):%H:%M:%S}"
        for d in damages
        if d.start_ns
    ]
    shown = ", ".join(spans[:_MAX_SPANS]) + (f" and {len(spans) - _MAX_SPANS} more" if len(spans) > _MAX_SPANS else "")
    parts = "1 part" if len(damages) == 1 else f"{len(damages)} parts"
    told = f"{parts} of the file, {sum(d.n_bytes for d in damages) / 1e6:.1f} MB, can't be read; all else is whole"
    return f"damaged: {told}" + (f"; missing are messages of {shown}" if spans else "")


def maps_of(maps: RecordedMaps) -> JointMap:
    """The maps that a recording begins with. RecordingError: they can't be read."""
    try:
        if (size := frame_content_size(maps.snapshot)) > _MOST_MAPS_BYTES:
            raise RecordingError(f"the recording's maps say that they have {size >> 20} MB: no building's have")
        state = unpack(maps.snapshot)
        return thaw(state["maps"], config_of(maps))
    except (SnapshotError, ZstdError, KeyError, TypeError) as error:
        raise RecordingError(f"the recording's maps can't be read: {error}") from error


def config_of(maps: RecordedMaps) -> FusionConfig:
    """What the maps were made with. RecordingError: this program knows no such settings."""
    try:
        return FusionConfig.model_validate_json(maps.config)
    except ValidationError as error:
        raise RecordingError(f"the recording's settings of fusion can't be read: {error.errors()[0]['msg']}") from error


def entry_of(view: LoggedView, payload: bytes) -> Entry:
    """A view as it stood in fusion's log."""
    return Entry(view.source, view.view, view.header, payload, view.reply, view.digest, view.fault)
