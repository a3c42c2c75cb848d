"""What ``surveilnav bench explain`` prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from surveilnav.benchmark.explain.make import Explained
    from surveilnav.benchmark.runner.summary import Interval


def explained_in_words(explained: Explained) -> Iterator[str]:
    """Where points are lost, and what each bound gains; a line each."""
    from surveilnav.benchmark.explain.loss import NAMES, Loss, losses
    from surveilnav.benchmark.explain.page import headline
    from surveilnav.benchmark.runner.summary import intervals, summarise

    records = explained.run.records
    s = summarise(records)
    yield headline(records)
    yield f"{s.episodes} searches: SR {s.sr}, SPL {s.spl}"
    for name, points in zip(Loss._fields, intervals(losses(records), [r.scene for r in records]), strict=True):
        yield f"  {NAMES[name][0]:<21} {points}"
    for gain in explained.gains:
        d = gain.difference
        yield f"with {gain.label}: SPL {d.spl.signed()}, SR {d.sr.signed()} in {d.pairs} searches"


def explained_numbers(explained: Explained) -> dict[str, Any]:
    """An explained run as one object; intervals are [mean, low, high]."""
    from surveilnav.benchmark.explain.groups import GROUPINGS
    from surveilnav.benchmark.explain.loss import Loss
    from surveilnav.benchmark.explain.page import headline

    records = explained.run.records
    gains = [
        {
            "settings": gain.label,
            "run": str(gain.bound.folder),
            "searches": gain.difference.pairs,
            "sr_difference": _rounded(gain.difference.sr),
            "spl_difference": _rounded(gain.difference.spl),
            "by_part": {name: _rounded(i) for name, i in zip(Loss._fields, gain.by_part, strict=True)},
        }
        for gain in explained.gains
    ]
    groups = {
        grouping.title: {name: _numbers(some) for name, some in grouping.groups(records).items()}
        for grouping in GROUPINGS
    }
    return {
        "said": headline(records),
        **_numbers(records),
        "groups": groups,
        "bounds": gains,
        "page": str(explained.page),
        "picture": str(explained.picture),
    }


def _numbers(records: Any) -> dict[str, Any]:
    from surveilnav.benchmark.explain.loss import Loss, losses
    from surveilnav.benchmark.runner.summary import intervals, summarise

    s, parts = summarise(records), intervals(losses(records), [r.scene for r in records])
    return {
        "searches": s.episodes,
        "sr": _rounded(s.sr),
        "spl": _rounded(s.spl),
        "missing": {name: _rounded(i) for name, i in zip(Loss._fields, parts, strict=True)},
    }


def _rounded(i: Interval) -> list[float]:
    return [round(v, 2) for v in (i.mean, i.low, i.high)]
