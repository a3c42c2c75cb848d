"""How tests wait for what other threads and processes bring about."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from surveilnav.bus import Node, Unanswered

T = TypeVar("T")


def until(condition: Callable[[], T], why: str | Callable[[], object] = "it never came", timeout_s: float = 20.0) -> T:
    """The condition's first true value; AssertionError after ``timeout_s``, with ``why``, or with what ``why()`` then is."""
    end_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < end_s, why() if callable(why) else why
        time.sleep(0.01)
    return found


def repeat_until(
    act: Callable[[], object],
    condition: Callable[[], T],
    why: str | Callable[[], object] = "it never came",
    timeout_s: float = 20.0,
) -> T:
    """``until(condition)``, with ``act()`` before each look, whatever it returns.

    For example a put: what is put before the router has heard of a reader is lost.
    """

    def act_and_look() -> T:
        act()
        return condition()

    return until(act_and_look, why, timeout_s)


def heard(ask: Callable[[], T]) -> T | None:
    """The answer; None where nobody is there yet: who declares an answer isn't known to the router at once."""
    try:
        return ask()
    except Unanswered as unanswered:
        if unanswered.timed_out:
            raise
        return None


def until_heard(ask: Callable[[], T], timeout_s: float = 20.0) -> T:
    """``ask()``'s answer, asked again until the router has heard of who answers; what isn't None."""
    answer = until(lambda: [a] if (a := heard(ask)) is not None else None, "nobody was ever heard", timeout_s)
    assert answer is not None
    return answer[0]


def patient(node: Node) -> Node:
    """The node, whose questions are asked again until the router has heard of who answers.

    They wait for an answer up to 20 s unless a test says otherwise: on a machine that runs other tests, too, five may be too few.
    """
    ask = node.ask
    node.ask = lambda *query, **options: until_heard(lambda: ask(*query, **{"timeout_s": 20.0, **options}))  # type: ignore[method-assign]
    return node
