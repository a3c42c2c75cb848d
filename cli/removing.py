"""What ``cameras remove`` and ``robots remove`` share: options, and taking a contribution out of the maps."""

from __future__ import annotations

import time
from collections.abc import Iterable
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.completing import known
from surveilnav.cli.options import console, print_result, results

if TYPE_CHECKING:
    from surveilnav.client import Client
    from surveilnav.rest import Removal

_POLL_S = 0.2

FromMaps = Annotated[
    bool,
    typer.Option(
        "--from-maps", help="Take what it has contributed out of the maps: as if it had never been there. Waits for it."
    ),
]
Since = Annotated[
    datetime | None,
    typer.Option(
        metavar="TIME", help="With --from-maps: only what it saw from this local time on (2026-01-31T10:00:00)."
    ),
]
Until = Annotated[
    datetime | None, typer.Option(metavar="TIME", help="With --from-maps: only what it saw up to this local time.")
]


def check_span(from_maps: bool, since: datetime | None, until: datetime | None) -> None:
    """Refuses a time span that would have no effect."""
    if (since or until) and not from_maps:
        raise typer.BadParameter("--since and --until say what is taken out of the maps: add --from-maps")


def known_or_as_typed(asked: Client, kind: str, typed: str, listed: Iterable[str]) -> str:
    """The id that begins with what was typed; what isn't listed any more may still be in the maps, and is taken as it is."""
    return known(asked, kind, typed) if any(id.startswith(typed) for id in listed) else typed


def remove_from_maps(asked: Client, source: str, since: datetime | None, until: datetime | None, as_json: bool) -> None:
    """Takes a contribution out of the maps, and waits until that is done. Exit 0 only if it was."""
    from surveilnav.cli.progress import counting

    removal = asked.remove_from_maps(source, since=_local(since), until=_local(until))
    with counting(console, "views") as progress:
        while removal.state == "running":
            if removal.views_total:
                progress(removal.views_done, removal.views_total, f"without {source}")
            time.sleep(_POLL_S)
            removal = asked.removal(removal.id)
    print_result(removal, as_json, lambda: results.print(in_words(removal), markup=False, soft_wrap=True))
    if removal.state == "failed":
        raise typer.Exit(1)


def in_words(removal: Removal) -> str:
    """What became of a removal."""
    if removal.state == "failed":
        return f"{removal.source}: still in the maps: {removal.message}"
    span = "".join(
        f" {word} {time.astimezone():%Y-%m-%d %H:%M:%S}"
        for word, time in (("since", removal.since), ("until", removal.until))
        if time is not None
    )
    if removal.state == "running":
        done = f" ({removal.views_done} of {removal.views_total} views)" if removal.views_total else ""
        return f"{removal.source}{span}: is being taken out of the maps{done}"
    return f"{removal.source}{span}: taken out of the maps by {removal.way}: {removal.message}"


def _local(time: datetime | None) -> datetime | None:
    """With this machine's time zone, if it has none."""
    return time.astimezone() if time is not None else None
