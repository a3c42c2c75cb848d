"""When a robot publishes its newest view again."""

from __future__ import annotations

from types import SimpleNamespace

from surveilnav.services.robot_node.publishing import ObservationPublisher


class Listeners:
    """A publisher of the bus, with listeners or without."""

    def __init__(self) -> None:
        self.matched, self.put_at = True, []
        self.now_s = 0.0

    def put(self, *_: object) -> None:
        self.put_at.append(self.now_s)


def repeats(is_heard, seconds: int) -> list[float]:
    """When the view of time 0 is published, second by second; ``is_heard``: by time, whether anybody listens."""
    bus = Listeners()
    robot = ObservationPublisher(SimpleNamespace(publisher=lambda *_, **__: bus), "r1")
    robot.publish(SimpleNamespace(message=None, payload=b"", truth=None), 0.0)
    for second in range(1, seconds):
        bus.now_s, bus.matched = float(second), is_heard(second)
        robot.repeat_if_due(bus.now_s)
    return bus.put_at


def test_pauses_grow_up_to_half_a_minute():
    assert repeats(lambda second: True, 125) == [0, 1, 3, 7, 15, 30, 60, 90, 120]


def test_who_listens_again_is_told_at_once():
    told = repeats(lambda second: not 40 <= second < 50, 60)
    assert told == [0, 1, 3, 7, 15, 30, 50, 52, 56]


def test_nobody_is_told_nothing():
    assert repeats(lambda second: False, 60) == [0]
