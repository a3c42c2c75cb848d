"""Requests to other services over the bus. A failure becomes a ``Problem``, which the client gets as the HTTP answer."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from surveilnav.bus import Node, Received, Refused, Unanswered, keep_request_id
from surveilnav.contract import Stream
from surveilnav.services.gateway.core.problems import Problem, refusal

#: Services that can be started by ``python -m surveilnav.services.{name}``.
_STARTABLE = ("planner", "fusion", "perception", "recorder")


def request(node: Node, owner: str, stream: Stream, message: Any = None, **options: Any) -> Received[Any]:
    """Sends a request and returns the answer. Blocks until the answer is there, at most for the contract's time-out.

    Args:
        owner: the asked service's name, for the texts of problems.

    Raises:
        Problem: the owner refuses, isn't there (503), or doesn't answer in time (504).
    """
    try:
        return node.ask(stream, message, **options)
    except Refused as error:
        raise refusal(error.name, str(error)) from error
    except Unanswered as error:
        if error.timed_out:
            raise Problem(504, "timeout", f"{owner} didn't answer in time; try again") from error
        raise absent(owner) from error


def request_existing(node: Node, what: str, id: str, owner: str, stream: Stream, **options: Any) -> Received[Any]:
    """Requests something that may not exist: a ``what`` with this ``id``, for example floor "1", from a service ``owner``.

    Raises:
        Problem: as ``request``, but 404 if a service of that kind is alive and says that it doesn't have the id.
    """
    try:
        return request(node, owner, stream, **options)
    except Problem as problem:
        if problem.status == 409 or (problem.name == "absent" and node.alive(owner)):
            detail = f"no {what} {id!r}" + (f": {problem.detail}" if problem.status == 409 else "")
            raise Problem(404, "not_found", detail) from problem
        raise


def request_each(node: Node, owner: str, stream: Stream, message: Any, not_mine: str, **options: Any) -> dict[str, Any]:
    """Sends a request to every service of a kind, and returns the answers by the services' ids.

    Args:
        owner: the kind, which is also the field of the stream's key that holds a service's id.
        not_mine: the name of the refusal by which a service says that this concerns others.

    Raises:
        Problem: none is there, one refuses for another reason, or this concerns none.
    """
    ids = sorted(node.alive(owner))
    if not ids:
        raise absent(owner)

    def ask(id: str) -> Any:
        try:
            return request(node, owner, stream, message, **options, **{owner: id}).message
        except Problem as problem:
            return problem

    with ThreadPoolExecutor(len(ids)) as pool:
        replies = dict(zip(ids, pool.map(keep_request_id(ask), ids), strict=True))
    answers = {id: reply for id, reply in replies.items() if not isinstance(reply, Problem)}
    problems = [reply for reply in replies.values() if isinstance(reply, Problem)]
    others = [problem for problem in problems if problem.name != not_mine]
    if others or not answers:
        raise (others or problems)[0]
    return answers


def absent(owner: str) -> Problem:
    """Problem 503: no service of that kind is alive. The detail says how to start one."""
    hint = f"; start one with `python -m surveilnav.services.{owner}`" if owner in _STARTABLE else ""
    return Problem(503, "absent", f"no {owner} is there{hint}")
