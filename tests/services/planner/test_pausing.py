"""A mission's pause: one that a person began isn't lost to one that ends by itself."""

from __future__ import annotations

from surveilnav.services.planner.pausing import Pause


def test_what_a_person_began_only_a_person_ends() -> None:
    pause = Pause(None)
    assert pause.begin("lunch")
    assert not pause.begin("waits for door lobby", lambda: True)
    pause.wait(0.0)
    assert (pause.reason, pause.stored_reason) == ("lunch", "lunch")
    assert not pause.ends_itself, "it isn't the door's"
    pause.end()
    assert pause.reason is None


def test_a_person_may_take_a_doors_pause_over() -> None:
    pause = Pause(None)
    assert pause.begin("waits for door lobby", lambda: True)
    assert pause.stored_reason is None
    pause.begin("lunch")
    pause.wait(0.0)
    assert pause.stored_reason == "lunch"
    assert not pause.ends_itself


def test_a_pause_that_begins_while_another_ends_itself_stays() -> None:
    pause = Pause(None)

    def is_over() -> bool:
        pause.begin("lunch")  # just now
        return True

    pause.begin("waits for door lobby", is_over)
    pause.wait(0.0)
    assert pause.reason == "lunch"


def test_a_doors_pause_ends_by_itself_and_by_a_person() -> None:
    pause = Pause(None)
    pause.begin("waits for door lobby", lambda: True)
    pause.wait(0.0)
    assert pause.reason is None
    pause.begin("waits for door lobby", lambda: False)
    pause.wait(0.0)
    assert pause.reason == "waits for door lobby"
    assert pause.ends_itself
    pause.end()
    assert pause.reason is None
