"""Answers that many clients ask for at the same time."""

from __future__ import annotations

import threading

import pytest

from surveilnav.services.gateway.answer_cache import _MAX_ENTRIES, AnswerCache


def test_many_at_once_have_one_made():
    cache, made, go = AnswerCache(max_age_s=60.0), [], threading.Event()

    def make():
        assert go.wait(10)
        made.append(1)
        return b"jpeg"

    got: list[bytes] = []
    viewers = [threading.Thread(target=lambda: got.append(cache.get("c1", make))) for _ in range(8)]
    for viewer in viewers:
        viewer.start()
    assert cache.get("c2", lambda: b"other") == b"other", "another camera's picture doesn't wait"
    go.set()
    for viewer in viewers:
        viewer.join(10)
    assert (got, made) == ([b"jpeg"] * 8, [1])


def test_a_camera_that_doesnt_answer_is_asked_once_for_all_who_wait():
    cache, asked = AnswerCache(max_age_s=60.0), []

    def fails():
        asked.append(1)
        raise ValueError("no camera")

    for _ in range(5):
        with pytest.raises(ValueError, match="no camera"):
            cache.get("c1", fails)
    assert asked == [1]


def test_an_old_one_is_made_anew_and_a_failure_isnt_kept():
    cache = AnswerCache(max_age_s=-1.0)
    assert [cache.get("c1", lambda i=i: bytes([i])) for i in range(3)] == [b"\0", b"\1", b"\2"]

    def fails():
        raise ValueError("no camera")

    with pytest.raises(ValueError, match="no camera"):
        cache.get("c2", fails)
    assert cache.get("c2", lambda: b"x") == b"x"


def test_not_more_than_so_many_are_kept():
    cache = AnswerCache(max_age_s=60.0)
    for i in range(3 * _MAX_ENTRIES):
        cache.get(i, lambda: b"")
    assert len(cache._entries) == _MAX_ENTRIES


def test_old_ones_are_dropped_and_one_that_is_being_made_stays():
    cache = AnswerCache(max_age_s=60.0)
    made, go, began = [], threading.Event(), threading.Event()

    def slowly():
        began.set()
        assert go.wait(10)
        return b"slow"

    cache.get("c1", lambda: b"one")
    viewer = threading.Thread(target=lambda: made.append(cache.get("c2", slowly)))
    viewer.start()
    assert began.wait(10)
    assert cache.drop_older(3600.0) == 0
    assert cache.drop_older(0.0) == 1
    assert cache.get("c1", lambda: b"another") == b"another"
    go.set()
    viewer.join(10)
    assert (made, cache.get("c2", lambda: b"anew")) == ([b"slow"], b"slow")


def test_after_clear_nobody_gets_what_was_asked_for_before():
    cache = AnswerCache(max_age_s=60.0)
    made, go, began = [], threading.Event(), threading.Event()

    def slowly():
        began.set()
        assert go.wait(10)
        return b"before"

    cache.get("list", lambda: b"before")
    viewer = threading.Thread(target=lambda: made.append(cache.get("other", slowly)))
    viewer.start()
    assert began.wait(10)
    cache.clear()
    assert cache.get("list", lambda: b"after") == b"after"
    assert cache.get("other", lambda: b"after") == b"after"
    go.set()
    viewer.join(10)
    assert (made, cache.get("other", lambda: b"anew")) == ([b"before"], b"after")
