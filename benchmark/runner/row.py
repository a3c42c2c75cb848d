"""One search as a row of a run's table: a fixed header, rounded numbers, and a checksum at its end."""

from __future__ import annotations

import csv
import io
import zlib

import msgspec

#: How a tier of the cameras' bytes is called, and its column.
_TIERS = {"jpeg+depth": "frame_bytes", "summaries": "summary_bytes"}
_COLUMNS = (
    "scene",
    "episode_id",
    "category",
    "success",
    "spl",
    "soft_spl",
    "steps",
    "path_m",
    "shortest_path_m",
    "distance_m",
    "reason",
    "seen",
    *_TIERS.values(),
    "seconds",
    "crc32",
)
HEADER = ",".join(_COLUMNS)


class EpisodeRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One search.

    ``distance_m``: where it ended, from the nearest viewpoint of a goal; None: no way leads there. ``reason``: why it
    failed, empty for a success. ``seen``: an object of the target's class lay in the maps at a goal. ``bytes``: by tier,
    what the cameras offered; empty without surveillance. ``seconds``: wall time, the only field that another run of the
    same settings may have different.
    """

    scene: str
    episode_id: str
    category: str
    success: bool
    spl: float
    soft_spl: float
    steps: int
    path_m: float
    shortest_path_m: float
    distance_m: float | None
    reason: str
    seen: bool
    bytes: dict[str, int]
    seconds: float

    @property
    def key(self) -> tuple[str, str]:
        """What tells it from other searches of its run."""
        return self.scene, self.episode_id


def row_of(record: EpisodeRecord) -> str:
    """A record as it is kept: shares and metres in millionths, seconds in tenths."""
    r = record
    if unknown := r.bytes.keys() - _TIERS.keys():
        raise ValueError(f"the table has columns for the tiers {', '.join(_TIERS)}, not for {min(unknown)!r}")
    distance = "" if r.distance_m is None else round(r.distance_m, 6)
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(
        [
            r.scene,
            r.episode_id,
            r.category,
            int(r.success),
            round(r.spl, 6),
            round(r.soft_spl, 6),
            r.steps,
            round(r.path_m, 6),
            round(r.shortest_path_m, 6),
            distance,
            r.reason,
            int(r.seen),
            *(r.bytes.get(tier, "") for tier in _TIERS),
            round(r.seconds, 1),
        ]
    )
    return f"{text.getvalue()},{_checksum(text.getvalue())}"


def record_of_row(row: str) -> EpisodeRecord:
    """The record of a row. ValueError: it isn't what ``row_of`` wrote."""
    text, _, checksum = row.rpartition(",")
    if _checksum(text) != checksum:
        raise ValueError(f"the checksum of {row[:60]!r} is {_checksum(text)}, it says {checksum!r}")
    (values,) = csv.reader([text])
    facts = dict(zip(_COLUMNS[:-1], values, strict=True))
    return EpisodeRecord(
        scene=facts["scene"],
        episode_id=facts["episode_id"],
        category=facts["category"],
        success=facts["success"] == "1",
        spl=float(facts["spl"]),
        soft_spl=float(facts["soft_spl"]),
        steps=int(facts["steps"]),
        path_m=float(facts["path_m"]),
        shortest_path_m=float(facts["shortest_path_m"]),
        distance_m=float(facts["distance_m"]) if facts["distance_m"] else None,
        reason=facts["reason"],
        seen=facts["seen"] == "1",
        bytes={tier: int(facts[name]) for tier, name in _TIERS.items() if facts[name]},
        seconds=float(facts["seconds"]),
    )


def key_of_row(row: str) -> tuple[str, str]:
    """A row's key, also of one that is damaged."""
    values = next(csv.reader([row]), [])
    scene, number = [*values, "", ""][:2]
    return scene, number


def _checksum(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"
