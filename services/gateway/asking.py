"""Questions to other services. What can't be had becomes a ``Problem``."""

from __future__ import annotations

from typing import Any

from surveilnav.bus import Node, Received, Refused, Unanswered
from surveilnav.contract import Stream
from surveilnav.services.gateway.core.problems import Problem, refusal


def ask(node: Node, who: str, stream: Stream, request: Any = None, **options: Any) -> Received[Any]:
    """The answer of ``who``, which is named in problems. Blocks for as long as the contract lets an answer take.

    Raises:
        Problem: refused, nobody there (503), or no answer in time (504).
    """
    try:
        return node.ask(stream, request, **options)
    except Refused as error:
        raise refusal(error.name, str(error)) from error
    except Unanswered as error:
        if error.timed_out:
            raise Problem(504, "timeout", f"{who} didn't answer in time; try again") from error
        raise absent(who) from error


def ask_known(node: Node, what: str, id: str, who: str, stream: Stream, **options: Any) -> Received[Any]:
    """The answer about something that may not exist: ``what`` with that ``id``, kept by a ``who``.

    Raises:
        Problem: as ``ask``; 404 if its owner is there, but refuses or has nobody in charge of it.
    """
    try:
        return ask(node, who, stream, **options)
    except Problem as problem:
        if problem.status == 409 or (problem.name == "absent" and node.alive(who)):
            detail = f"no {what} {id!r}" + (f": {problem.detail}" if problem.status == 409 else "")
            raise Problem(404, "not_found", detail) from problem
        raise


def absent(who: str) -> Problem:
    """503: nobody is there to ask, and how to start one."""
    hint = (
        f"; start one with `python -m surveilnav.services.{who}`"
        if who in ("planner", "fusion", "perception", "recorder")
        else ""
    )
    return Problem(503, "absent", f"no {who} is there{hint}")
