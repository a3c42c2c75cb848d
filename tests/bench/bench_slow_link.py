"""A search with eight cameras behind one link of 10 Mbit/s, by tier: does it succeed, and do cameras still answer?

    pytest -s tests/bench/bench_slow_link.py

``test_counts_against_the_kernel`` compares what the cameras counted with what went through the link's network device and with
what a bare Zenoh subscriber got, over ``SECONDS`` (600).

Cameras run in a network namespace whose only way out is shaped by ``tc tbf``; everything else runs outside. Meanwhile each camera
is asked for its description twice a second. It needs root and the commands ip and tc. ``RATE``, ``BUILDING``, ``TARGET`` and
``CAMERAS`` may be set in the environment.
"""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import zenoh

from surveilnav.bus.router import free_port
from surveilnav.cli import stack as stacks
from surveilnav.contract import CAMERA_INFO, ROOT
from surveilnav.errors import BusError
from surveilnav.messages import FINISHED_STATES
from tests.bench.bench_bus import Link, slow_link
from tests.bench.bench_traffic import Offered
from tests.e2e.conftest import System, starting

RATE = os.environ.get("RATE", "10mbit")
BUILDING, TARGET = os.environ.get("BUILDING", "3_bedroom"), os.environ.get("TARGET", "tv")
CAMERAS = int(os.environ.get("CAMERAS", "8"))


def behind(link: Link, monkeypatch) -> None:
    """Has the stack start cameras inside of the link's namespace, and its router where they reach it."""
    usual = stacks.launch

    def launch(
        module: str, arguments: tuple[str, ...], variables: dict[str, str], log: Path
    ) -> subprocess.Popen[bytes]:
        port = variables["SURVEILNAV_BUS__ROUTER"].rpartition(":")[2]
        if module.endswith("bus.router"):
            arguments = ("--listen", f"tcp/0.0.0.0:{port}")
        if not module.endswith("camera_node"):
            return usual(module, arguments, variables, log)
        popen = subprocess.Popen

        def inside(command: list[str], **options: object) -> subprocess.Popen[bytes]:
            return popen([*link.inside, *command], **options)

        with monkeypatch.context() as patch:
            patch.setattr(subprocess, "Popen", inside)
            return usual(module, arguments, {**variables, "SURVEILNAV_BUS__ROUTER": f"tcp/{link.host}:{port}"}, log)

    monkeypatch.setattr(stacks, "launch", launch)


class Asking:
    """Asks every camera for its description twice a second, and notes how long each answer took."""

    def __init__(self, s: System) -> None:
        self._s, self._ended = s, threading.Event()
        self.took_s: list[float] = []
        self.unanswered = 0
        self._threads = [threading.Thread(target=self._ask, args=(c,)) for c in s.building.plan.cameras]

    def _ask(self, camera) -> None:
        while not self._ended.wait(0.5):
            began_s = time.monotonic()
            try:
                self._s.node.ask(CAMERA_INFO, floor=camera.floor, camera=camera.name, timeout_s=5.0)
                self.took_s.append(time.monotonic() - began_s)
            except BusError:
                self.unanswered += 1

    def __enter__(self) -> Asking:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()


@pytest.mark.slow
@pytest.mark.parametrize(("tier", "budget_kb_s"), [("jpeg+depth", ""), ("features", ""), ("auto", ""), ("auto", "20")])
def test_a_search_over_a_slow_link(tmp_path, home_cache, monkeypatch, tier, budget_kb_s):
    monkeypatch.setenv("SURVEILNAV_CAMERA__TIER", tier)
    monkeypatch.setenv("SURVEILNAV_CAMERA__PERCEPTION", "compact")
    if budget_kb_s:
        monkeypatch.setenv("SURVEILNAV_CAMERA__BUDGET_KB_S", budget_kb_s)
    with slow_link(RATE) as link, starting(tmp_path, home_cache) as start:
        if link is None:
            pytest.skip("no slow link on this machine: root, ip and tc are needed")
        behind(link, monkeypatch)
        s = start(BUILDING, cameras=CAMERAS, perception="compact", gateway_port=free_port())
        before = Offered(s)
        with Asking(s) as asking:
            began_s = time.monotonic()
            s.search(TARGET, mission="m", max_steps=400)
            ended = s.wait(lambda m: m.state in FINISHED_STATES, 300, "m")
            took_s = time.monotonic() - began_s
        frames = sum(n for (_, key), n in (Offered(s).by_key - before.by_key).items() if "/frame/" in key)
        ms = 1000 * np.array(asking.took_s)
        print(
            f"\n| `{tier}`{f', {budget_kb_s} kB/s a camera' if budget_kb_s else ''} | {ended.state}, found: {ended.found} "
            f"| {ended.step} steps, {took_s:.1f} s | {frames / 1e6:.2f} MB | {np.median(ms):.0f}, {np.percentile(ms, 99):.0f}, "
            f"{ms.max():.0f} ms | {asking.unanswered} of {len(ms) + asking.unanswered} |"
        )


class Bare:
    """What a subscriber without our runtime gets of the cameras' frames: bytes of payloads, attachments and keys."""

    def __init__(self, router: str) -> None:
        self.n_bytes = 0
        config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [router]}}))
        self._session = zenoh.open(config)
        self._subscriber = self._session.declare_subscriber(f"{ROOT}/**/frame/*", self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        attachment = len(sample.attachment) if sample.attachment is not None else 0
        self.n_bytes += len(sample.payload) + attachment + len(str(sample.key_expr))

    def close(self) -> None:
        self._session.close()


def through(device: str) -> int:
    """Bytes of TCP that came in by a device: without the headers of Ethernet, IP and TCP with timestamps."""
    folder = Path("/sys/class/net") / device / "statistics"
    n_bytes, n_packets = (int((folder / f"rx_{what}").read_text()) for what in ("bytes", "packets"))
    return n_bytes - 66 * n_packets


def counted(s: System) -> tuple[int, int]:
    """(offered bytes of frames, bytes on the wire) of all cameras, as they count them."""
    frames = wire = 0
    for camera in s.building.plan.cameras:
        report = s.traffic("camera", camera.name)
        frames += sum(row.n_bytes for row in report.rows if "/frame/" in row.key and row.direction == "offered")
        wire += report.wire_sent_bytes
    return frames, wire


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_counts_against_the_kernel(tmp_path, home_cache, monkeypatch):
    seconds = float(os.environ.get("SECONDS", "600"))
    with slow_link("1gbit") as link, starting(tmp_path, home_cache) as start:
        if link is None:
            pytest.skip("no link of its own on this machine: root, ip and tc are needed")
        behind(link, monkeypatch)
        s = start(BUILDING, cameras=CAMERAS, perception="oracle", gateway_port=free_port(), surveillance=False)
        device = f"o{os.getpid()}"
        before, kernel = counted(s), through(device)
        began_s = time.monotonic()
        rounds, got = 0, 0
        while time.monotonic() - began_s < seconds:  # a listener that comes and goes is sent everything each time
            bare = Bare(s.stack.bus.router)
            time.sleep(min(seconds / 5, 60.0))
            got, rounds = got + bare.n_bytes, rounds + 1
            bare.close()
        time.sleep(2.0)
        after, kernel = counted(s), through(device) - kernel
        frames, wire = (b - a for a, b in zip(before, after, strict=True))
        print(f"\n{rounds} times, {time.monotonic() - began_s:.0f} s")
        print(f"offered {frames:,} B, a bare subscriber got {got:,} B ({100 * (got / frames - 1):+.3f} %)")
        print(f"wire {wire:,} B, the kernel's device {kernel:,} B ({100 * (wire / kernel - 1):+.3f} %)")
        assert got == frames
        assert wire == pytest.approx(kernel, rel=0.005)
