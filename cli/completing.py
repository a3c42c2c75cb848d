"""Ids that people needn't type whole: what they meant, and what the shell offers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from surveilnav.client import Client

#: The shell waits for no gateway longer than this.
_PATIENCE_S = 1.0
#: So many ids are named in a mistake.
_SHOWN = 5


def known(asked: Client, what: str, typed: str) -> str:
    """The id that was meant: as typed, or the only one that begins so.

    Args:
        what: "mission", "camera" or "robot", whose list is the command's plural.

    Raises:
        GatewayError: none is or begins so, or several do.
    """
    from surveilnav.errors import GatewayError

    ids: list[str] = [row.id for row in getattr(asked, f"{what}s")()]
    if typed in ids:
        return typed
    fitting = [id for id in ids if id.startswith(typed)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise GatewayError(
            f"unknown_{what}", f"{len(fitting)} {what}s begin with {typed!r}: {_few(fitting)}; type more of it"
        )
    there = f"there are {_few(ids)}" if ids else "there is none"
    raise GatewayError(f"unknown_{what}", f"there is no {what} {typed!r}; {there} (`surveilnav {what}s` lists them)")


def _few(ids: Sequence[str]) -> str:
    more = len(ids) - _SHOWN
    return ", ".join(ids[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def mission_ids(ctx: typer.Context, incomplete: str) -> list[str]:
    """Missions that begin so, the newest first."""
    return _offered(ctx, "missions", incomplete)


def camera_ids(ctx: typer.Context, incomplete: str) -> list[str]:
    """Cameras that begin so."""
    return _offered(ctx, "cameras", incomplete)


def robot_ids(ctx: typer.Context, incomplete: str) -> list[str]:
    """Robots that begin so."""
    return _offered(ctx, "robots", incomplete)


def _offered(ctx: typer.Context, what: str, incomplete: str) -> list[str]:
    """Ids of a list of the gateway; none if it doesn't answer, for a shell can show no mistake."""
    from surveilnav.client import Client
    from surveilnav.errors import GatewayError

    try:
        with Client(ctx.params["url"], timeout_s=_PATIENCE_S) as asked:
            return [row.id for row in getattr(asked, what)() if row.id.startswith(incomplete)]
    except GatewayError:
        return []
