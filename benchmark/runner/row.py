"""One search as a row of a run's table: a fixed header, rounded numbers, and a checksum at its end."""

from __future__ import annotations

import csv
import io
import zlib

import msgspec

from surveilnav.benchmark.play.approach import Approach

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
)
#: What a search's loss is explained by: how near it came to a goal, and what cameras knew before it began.
EXPLAINING = (*Approach.__struct_fields__, "camera_chance")
HEADER = ",".join((*_COLUMNS, *EXPLAINING, "crc32"))
#: The header of tables that older programs wrote. They lack the columns ``EXPLAINING``.
OLD_HEADER = ",".join((*_COLUMNS, "crc32"))


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
    approach: Approach | None = None
    camera_chance: float | None = None

    @property
    def key(self) -> tuple[str, str]:
        """What tells it from other searches of its run."""
        return self.scene, self.episode_id


def row_of(record: EpisodeRecord) -> str:
    """A record as it is kept: shares and metres in millionths, seconds in tenths, what explains it in thousandths.

    ValueError: a tier without a column, or a record that says nothing of its approach.
    """
    r = record
    if r.approach is None:
        raise ValueError(f"the search {r.key} doesn't say how near it came to a goal: it was read from an older table")
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
            *("" if v is None else round(v, 3) for v in (*msgspec.structs.astuple(r.approach), r.camera_chance)),
        ]
    )
    return f"{text.getvalue()},{_checksum(text.getvalue())}"


def record_of_row(row: str) -> EpisodeRecord:
    """The record of a row. ValueError: it isn't what ``row_of`` wrote."""
    text, _, checksum = row.rpartition(",")
    if _checksum(text) != checksum:
        raise ValueError(f"the checksum of {row[:60]!r} is {_checksum(text)}, it says {checksum!r}")
    (values,) = csv.reader([text])
    is_old = len(values) == len(_COLUMNS)
    facts = dict(zip(_COLUMNS if is_old else (*_COLUMNS, *EXPLAINING), values, strict=True))
    near = {name: float(facts[name]) if facts[name] else None for name in EXPLAINING if not is_old}
    camera_chance = near.pop("camera_chance", None)
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
        approach=None if is_old else Approach(**near),
        camera_chance=camera_chance,
    )


def key_of_row(row: str) -> tuple[str, str]:
    """A row's key, also of one that is damaged."""
    values = next(csv.reader([row]), [])
    scene, number = [*values, "", ""][:2]
    return scene, number


def _checksum(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"
