"""What a search puts on the bus: by link and key, the search, the time after it, and a second search for the same thing.

    pytest -s tests/bench/bench_traffic.py

The links are those of `GET /api/v1/traffic`. ``BUILDING``, ``CAMERAS``, ``TARGET`` and ``IDLE_S`` may be set in the environment.
"""

from __future__ import annotations

import os
import re
import time
from collections import Counter

import pytest

from surveilnav.bus.router import free_port
from surveilnav.contract import ROOT, TRAFFIC
from surveilnav.messages import FINISHED_STATES
from surveilnav.services.gateway.core.traffic import link_of
from tests.e2e.conftest import System, starting

BUILDING, TARGET = os.environ.get("BUILDING", "3_bedroom"), os.environ.get("TARGET", "tv")
CAMERAS, IDLE_S = int(os.environ.get("CAMERAS", "4")), float(os.environ.get("IDLE_S", "120"))
#: So long after a search its last messages are still under way.
SETTLE_S = 4.0


class Offered:
    """What all nodes have offered so far, in bytes: by link and key, whose numbers are replaced by N; and on the wire."""

    def __init__(self, s: System) -> None:
        self.by_key: Counter[tuple[str, str]] = Counter()
        self.wire_bytes = 0
        for answer in s.node.ask_all(TRAFFIC, timeout_s=3.0):
            report = answer.message
            self.wire_bytes += report.wire_sent_bytes or 0
            for row in report.rows:
                if row.direction == "offered":
                    self.by_key[link_of(report.kind, row.key), _pattern(row.key)] += row.n_bytes


def _pattern(key: str) -> str:
    return re.sub(r"\d+", "N", "/".join(key.removeprefix(ROOT + "/").split("/")[1:]))


def show(title: str, before: Offered, after: Offered, seconds: float) -> dict[str, int]:
    """Prints what was offered in between, and returns it by link."""
    keys = after.by_key - before.by_key
    links: Counter[str] = Counter()
    for (link, _), n_bytes in keys.items():
        links[link] += n_bytes
    wire_bytes = after.wire_bytes - before.wire_bytes
    print(
        f"\n{title}: {sum(links.values()) / 1e6:.2f} MB offered, {wire_bytes / 1e6:.2f} MB on the wire, {seconds:.0f} s"
    )
    for link in sorted(links):
        print(f"  {link}: {links[link] / 1e6:.3f} MB ({links[link] / seconds / 1e3:.1f} kB/s)")
        for (of, key), n_bytes in keys.most_common():
            if of == link and n_bytes > 0.01 * links[link]:
                print(f"    {n_bytes / 1e6:9.3f} MB  {key}")
    return dict(links)


def search(s: System, mission: str) -> float:
    """Searches, and returns the seconds until it ended."""
    began_s = time.monotonic()
    s.search(TARGET, mission=mission, max_steps=400)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 600, mission)
    took_s = time.monotonic() - began_s
    assert ended.found, ended
    time.sleep(SETTLE_S)
    return took_s


@pytest.mark.slow
def test_what_a_search_puts_on_the_bus(tmp_path, home_cache):
    with starting(tmp_path, home_cache) as start:
        s = start(BUILDING, cameras=CAMERAS, perception="compact", gateway_port=free_port(), recorder=True)
        counts = [Offered(s)]
        took_s = search(s, "first")
        counts.append(Offered(s))
        time.sleep(IDLE_S)
        counts.append(Offered(s))
        again_s = search(s, "second")
        counts.append(Offered(s))
        show("a search", counts[0], counts[1], took_s)
        show("idle", counts[1], counts[2], IDLE_S)
        second = show("the same again", counts[2], counts[3], again_s)
        frames = sum(n for (_, key), n in (counts[3].by_key - counts[2].by_key).items() if "/frame/" in key)
        assert frames == 0, "the cameras of a known building need to send nothing"
        assert second["server"] > 0
