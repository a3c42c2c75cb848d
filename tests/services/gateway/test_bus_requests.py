"""What a request without an answer becomes."""

from __future__ import annotations

from typing import Any

import pytest

from surveilnav.bus import Refused, Unanswered
from surveilnav.contract import MISSION_STATUS
from surveilnav.errors import BusError
from surveilnav.services.gateway.bus_requests import request, request_existing
from surveilnav.services.gateway.core.problems import Problem


class Silent:
    """A node whose questions all fail alike."""

    def __init__(self, error: BusError, alive: bool) -> None:
        self._error, self._alive = error, alive

    def ask(self, *_: Any, **__: Any) -> Any:
        raise self._error

    def alive(self, kind: str) -> set[str]:
        return {kind} if self._alive else set()


LATE = Unanswered("no answer from a/b: nobody answers", timed_out=True)
ABSENT = Unanswered("no answer from not within: nobody is there")


@pytest.mark.parametrize(
    ("error", "alive", "status", "name"),
    [
        (LATE, True, 504, "timeout"),
        (LATE, False, 504, "timeout"),
        (ABSENT, True, 503, "absent"),
        (ABSENT, False, 503, "absent"),
        (Refused("busy", "later"), True, 503, "busy"),
        (Refused("odd", "no"), True, 409, "odd"),
    ],
)
def test_a_timeout_isnt_an_absence(error, alive, status, name):
    with pytest.raises(Problem) as told:
        request(Silent(error, alive), "planner", MISSION_STATUS)  # type: ignore[arg-type]
    assert (told.value.status, told.value.name) == (status, name)


@pytest.mark.parametrize(
    ("error", "alive", "status"),
    [
        (LATE, True, 504),
        (ABSENT, True, 404),
        (ABSENT, False, 503),
        (Refused("busy", "later"), True, 503),
        (Refused("odd", "no"), True, 404),
    ],
)
def test_what_its_owner_doesnt_know_isnt_there(error, alive, status):
    with pytest.raises(Problem) as told:
        request_existing(Silent(error, alive), "mission", "m-1", "planner", MISSION_STATUS)  # type: ignore[arg-type]
    assert told.value.status == status
