from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from surveilnav.services.camera_node.core.stream_health import (
    FROZEN_S,
    NO_FRAMES_S,
    RECONNECT_AFTER_S,
    FrameStatistics,
    StreamHealth,
)


def statistics(seed: int = 0, fault: str = "") -> FrameStatistics:
    rng = np.random.default_rng(seed)
    picture = rng.integers(30, 220, (96, 128, 3), np.uint8)
    if fault == "black":
        picture = rng.integers(0, 3, (96, 128, 3), np.uint8)
    if fault == "grey":
        picture = np.full((96, 128, 3), 128, np.uint8)
        picture[0, 0] = seed % 255
    if fault == "garbled":
        picture[40:] = 128
    return FrameStatistics.from_picture(picture)


@pytest.mark.parametrize("fault", ["", "black", "grey", "garbled"])
def test_a_picture_is_judged_by_itself(fault: str) -> None:
    assert statistics(3, fault).fault == fault


def test_pictures_make_a_stream_live() -> None:
    health = StreamHealth()
    health.open(0.0)
    assert health.state == "connecting"
    health.frame(2.9, statistics(1))
    assert (health.state, health.usable, health.pop_messages()) == ("live", True, [])


@pytest.mark.parametrize("fault", ["black", "grey", "garbled"])
def test_a_fault_of_the_picture_is_named_after_three_seconds_and_used_at_no_time(fault: str) -> None:
    health = live()
    health.frame(10.0, statistics(2, fault))
    assert (health.state, health.usable) == ("live", False)
    health.frame(13.5, statistics(3, fault))
    assert health.state == fault
    assert health.pop_messages() == [f"the stream is lost: {fault}, its pictures show nothing"]
    assert not health.reconnect_due(1e6)
    health.frame(14.0, statistics(4))
    assert (health.state, health.usable) == ("live", True)
    assert health.pop_messages() == [f"the stream is back after 0 s ({fault})"]


def test_the_same_picture_bit_by_bit_is_frozen_even_after_it_was_opened_anew() -> None:
    health = live()
    for t in range(6, 32):
        health.frame(float(t), statistics(7))
    assert health.state == "frozen"
    assert health.reason == "the same picture for 25 s"
    assert not health.usable
    health.open(32.0)
    health.frame(35.0, statistics(7))
    assert health.state == "frozen"
    health.frame(36.0, statistics(8))
    assert health.state == "live"


def test_a_noisy_picture_is_not_frozen() -> None:
    health = live()
    for t in range(6, 100):
        health.frame(float(t), statistics(t))
        assert health.usable


def test_silence_is_noticed_and_the_stream_opened_anew_after_growing_pauses() -> None:
    health = live()
    health.tick(5.0 + NO_FRAMES_S - 0.1)
    assert health.state == "live"
    health.tick(5.0 + NO_FRAMES_S)
    assert (health.state, health.reason) == ("no_frames", "no picture for 20 s")
    now_s, pauses = 5.0 + NO_FRAMES_S, []
    for _ in range(6):
        since_s = now_s
        while not health.reconnect_due(now_s):
            now_s += 0.5
        pauses.append(now_s - since_s)
        health.open(now_s)
        assert not health.reconnect_due(now_s + 1000.0)  # while it is being opened
        health.failure(now_s, "refused")
    assert tuple(pauses) == (*RECONNECT_AFTER_S, 60.0, 60.0)
    assert health.n_reconnects == 6
    assert health.pop_messages() == ["the stream is lost: no_frames, no picture for 20 s"]
    health.open(now_s)
    health.frame(now_s + 1.0, statistics(9))
    assert len(health.pop_messages()) == 1


def test_an_attempt_that_hangs_counts_as_silence() -> None:
    health = StreamHealth()
    health.open(0.0)
    health.failure(1.0, "refused")
    health.open(2.0)
    health.tick(2.0 + NO_FRAMES_S)
    assert health.state == "no_frames"
    assert health.reconnect_due(2.0 + NO_FRAMES_S + RECONNECT_AFTER_S[1])


def test_after_a_steady_minute_the_pauses_begin_anew() -> None:
    health = live()
    for _ in range(3):
        health.failure(6.0, "ended")
        health.open(7.0)
    for t in range(10, 80):
        health.frame(float(t), statistics(t))
    health.failure(80.0, "ended")
    assert health.reconnect_due(81.0)


def test_frozen_takes_a_while() -> None:
    health = StreamHealth()
    health.open(0.0)
    health.frame(1.0, statistics(1))
    health.frame(1.0 + FROZEN_S - 0.1, statistics(1))
    assert health.state == "live"


def live() -> StreamHealth:
    health = StreamHealth()
    health.open(0.0)
    for t in times(1.0, 5.0):
        health.frame(t, statistics(int(10 * t) + 100))
    assert health.state == "live"
    return health


def times(begin: float, end: float) -> Iterator[float]:
    return iter(np.arange(begin, end + 0.1, 0.5).tolist())


def test_a_camera_that_was_moved_is_named_and_not_believed_until_it_is_turned_back() -> None:
    health = StreamHealth()
    health.open(0.0)
    health.frame(1.0, statistics(1))
    health.frame(2.0, statistics(2), moved="its picture is shifted by 3 degrees")
    assert (health.state, health.usable, health.reconnect_due(1000.0)) == ("moved", False, False)
    assert health.pop_messages() == ["the stream is lost: moved, its picture is shifted by 3 degrees"]
    health.frame(9.0, statistics(3))
    assert (health.state, health.usable) == ("live", True)
