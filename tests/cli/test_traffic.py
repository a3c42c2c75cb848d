"""``surveilnav traffic --watch``: bytes per second on each kind of link."""

from __future__ import annotations

from itertools import islice

from surveilnav.cli.traffic import rate_line, watched_rates
from surveilnav.rest import LinkTraffic, Traffic


def test_rates_are_what_was_offered_in_between():
    links = [
        LinkTraffic(camera_bytes=1000, robot_bytes=500, server_bytes=90, simulation_bytes=7),
        LinkTraffic(camera_bytes=11_000, robot_bytes=500, server_bytes=190, simulation_bytes=7),
        LinkTraffic(camera_bytes=2000, robot_bytes=1500, server_bytes=190, simulation_bytes=7),  # a camera began anew
    ]
    asked, now_s = iter(links), [100.0]

    def sleep(seconds: float) -> None:
        now_s[0] += 2 * seconds  # the machine is busy

    def ask() -> Traffic:
        return Traffic(
            offered_bytes=0, delivered_bytes=0, wire_sent_bytes=None, links=next(asked), nodes=[], cameras=[], robots=[]
        )

    first, second = islice(watched_rates(ask, sleep, lambda: now_s[0]), 2)
    assert first == {"camera": 1000.0, "robot": 0.0, "server": 10.0, "simulation": 0.0}
    assert second == {"camera": 0.0, "robot": 100.0, "server": 0.0, "simulation": 0.0}
    assert rate_line(first) == "camera links   1.0 kB/s   robot links      0 B/s   server links     10 B/s"
