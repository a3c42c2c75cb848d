"""Frames through our runtime beside bare Zenoh, in the same topology and in turns: how many a second arrive.

    python tests/bench/bench_frames.py [--seconds 5] [--rounds 5]

A sender and a reader, each a process of its own, and the router between them, on one machine. The sender puts frames as fast as
they are taken. Bare Zenoh sends the same bytes, with the same settings of the session and the publisher; it neither makes nor
reads headers, and counts nothing.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
import time

import numpy as np
import zenoh

from surveilnav.bus import BusSettings, Node, clock_ns
from surveilnav.bus.connection import CONGESTION, PRIORITY
from surveilnav.bus.router import free_port
from surveilnav.contract import CAMERA_FRAME
from surveilnav.geometry import Pinhole, Pose
from surveilnav.messages import FrameHeader, PayloadPart

SIZES = {"jpeg+depth": 835_000, "features": 7_400}
PLACE = {"floor": "0", "camera": "c1", "view": 0}
#: Frames that arrive in the first moments aren't counted.
WARM_UP_S = 1.0


def header(n_bytes: int, seq: int) -> FrameHeader:
    """A header like a camera's."""
    here = Pose((0.0, 0.0, 2.5), (0.0, 0.0, 0.0, 1.0))
    return FrameHeader(
        stamp_ns=clock_ns(),
        source="camera/c1",
        view=0,
        seq=seq,
        floor="0",
        T_world_camera=here,
        camera=Pinhole(1280, 1280, 640.0, 640.0, 639.5, 639.5),
        mounting_offset_m=2.5,
        depth_range_m=(0.1, 10.0),
        image=PayloadPart("jpeg", n_bytes // 2),
        depth=PayloadPart("depth-invq-zstd", n_bytes - n_bytes // 2),
    )


def send_ours(settings: BusSettings, n_bytes: int) -> None:
    """Puts frames for ever, as a camera does."""
    with Node("camera", "c1", settings, alive=False) as node:
        publisher, payload = node.publisher(CAMERA_FRAME, **PLACE), np.random.default_rng(0).bytes(n_bytes)
        for seq in itertools.count():
            publisher.put(header(n_bytes, seq), payload)


def send_bare(settings: BusSettings, n_bytes: int) -> None:
    """Puts as many bytes for ever."""
    session = zenoh.open(zenoh.Config.from_json5(settings.client_config()))
    publisher = session.declare_publisher(
        CAMERA_FRAME.key_for(building=settings.building, **PLACE),
        congestion_control=CONGESTION[CAMERA_FRAME.when_full],
        priority=PRIORITY[CAMERA_FRAME.priority],
    )
    payload, attachment = np.random.default_rng(0).bytes(n_bytes), bytes(400)
    while True:
        publisher.put(payload, attachment=attachment)


class Ours:
    """Reads with our runtime."""

    def __init__(self, settings: BusSettings) -> None:
        self.arrived = 0
        self._node = Node("fusion", "f", settings, alive=False).__enter__()
        self._node.subscribe(CAMERA_FRAME, self._on_frame, **PLACE)

    def _on_frame(self, frame: object) -> None:
        self.arrived += 1

    def close(self) -> None:
        self._node.__exit__(None, None, None)


class Bare:
    """Reads without it."""

    def __init__(self, settings: BusSettings) -> None:
        self.arrived = 0
        self._session = zenoh.open(zenoh.Config.from_json5(settings.client_config()))
        key = CAMERA_FRAME.key_for(building=settings.building, **PLACE)
        self._subscriber = self._session.declare_subscriber(key, self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        bytes(sample.payload)
        self.arrived += 1

    def close(self) -> None:
        self._session.close()


def rate_hz(way: str, n_bytes: int, settings: BusSettings, seconds: float) -> float:
    """How many frames a second arrive."""
    command = [sys.executable, __file__, "--send", way, "--router", settings.router, "--bytes", str(n_bytes)]
    reader, sender = (Ours if way == "ours" else Bare)(settings), subprocess.Popen(command)
    try:
        while not reader.arrived:
            time.sleep(0.01)
        time.sleep(WARM_UP_S)
        before, began_s = reader.arrived, time.monotonic()
        time.sleep(seconds)
        return (reader.arrived - before) / (time.monotonic() - began_s)
    finally:
        sender.kill()
        sender.wait()
        reader.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--send", choices=("ours", "bare"), help=argparse.SUPPRESS)
    parser.add_argument("--router", default=f"tcp/127.0.0.1:{free_port()}", help=argparse.SUPPRESS)
    parser.add_argument("--bytes", type=int, default=0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    settings = BusSettings(router=arguments.router, building="b")
    if arguments.send:
        (send_ours if arguments.send == "ours" else send_bare)(settings, arguments.bytes)
        return
    router = subprocess.Popen([sys.executable, "-m", "surveilnav.bus.router", "--listen", settings.router])
    try:
        print(
            "| frames like those of | bytes | bare Zenoh | ours | ours / bare: median, least, most |\n|---|---|---|---|---|"
        )
        for tier, n_bytes in SIZES.items():
            rates = np.array(
                [
                    [rate_hz(way, n_bytes, settings, arguments.seconds) for way in ("bare", "ours")]
                    for _ in range(arguments.rounds)
                ]
            )
            (bare_hz, ours_hz), ratios = np.median(rates, axis=0), rates[:, 1] / rates[:, 0]
            shown = f"{np.median(ratios):.2f}, {ratios.min():.2f}, {ratios.max():.2f}"
            print(f"| `{tier}` | {n_bytes:,} | {bare_hz:.0f}/s | {ours_hz:.0f}/s | {shown} |", flush=True)
    finally:
        router.terminate()
        router.wait()


if __name__ == "__main__":
    main()
