"""What pages and programs cost the gateway, and the search beside them. Prints a table.

.venv/bin/python tests/bench/bench_gateway.py [--seconds 300] [--pages 20] [--requests-hz 50] [--building 2_bedroom]

A real system searches, by turns with and without load. A page holds the streams ``/live`` and ``/tiles``, and loads four
layers whenever maps changed, at most once a second, as the page does. Programs read states at a steady rate. The load is a
process of its own on the same machine, so that what it costs itself slows the search, too. A step is from one sequence number
of the robot to the next.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import itertools
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.router import free_port
from surveilnav.client import Client
from surveilnav.contract import ROBOT_STATUS

ROOT = Path(__file__).parents[2]
LAYERS = ("explored", "value", "occupancy", "frontier")
READS = (
    "missions",
    "missions?state=active",
    "robots",
    "cameras",
    "floors",
    "objects?limit=20",
    "services",
    "traffic",
    "perception",
    "buildings",
)


# --- load: a process of its own -------------------------------------------------------------------------------------


def load(port: int, pages: int, requests_hz: float, tiles: str, until_s: float) -> dict[str, Any]:
    """Asks as pages and programs do until the clock says ``until_s``; what programs read, and how long each took [ms]."""
    taken: list[tuple[str, float]] = []
    failed: list[str] = []
    each_s = 8 / requests_hz
    threads = [threading.Thread(target=_page, args=(port, tiles, until_s, failed), daemon=True) for _ in range(pages)]
    threads += [
        threading.Thread(target=_program, args=(port, n * each_s / 8, each_s, until_s, taken, failed), daemon=True)
        for n in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(until_s - time.time() + 10)
    return {"ms": taken, "failed": failed[:5], "n_failed": len(failed), "cpu_s": sum(os.times()[:2])}


def _page(port: int, tiles: str, until_s: float, failed: list[str]) -> None:
    watcher = threading.Thread(target=_stream, args=(port, f"/api/v1/tiles?{tiles}", until_s, None), daemon=True)
    watcher.start()
    changed = threading.Event()
    threading.Thread(target=_stream, args=(port, "/api/v1/live", until_s, changed), daemon=True).start()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    tags: dict[str, str] = {}
    while time.time() < until_s:
        if changed.wait(0.2):
            changed.clear()
            for layer in LAYERS:
                _get(connection, f"/api/v1/floors/0/layers/{layer}.png", failed, tags)
            time.sleep(1.0)


def _stream(port: int, path: str, until_s: float, changed: threading.Event | None) -> None:
    """Reads what comes; ``changed`` is set when a floor's state came."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    with contextlib.suppress(OSError, http.client.HTTPException):
        connection.request("GET", path)
        answer = connection.getresponse()
        while time.time() < until_s and (line := answer.readline()):
            if changed is not None and line.startswith(b"event: floor"):
                changed.set()


def _program(
    port: int, after_s: float, each_s: float, until_s: float, taken: list[tuple[str, float]], failed: list[str]
) -> None:
    time.sleep(after_s)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    due_s = time.time()
    for read in itertools.cycle(READS):
        due_s += each_s
        time.sleep(max(0.0, due_s - time.time()))
        if time.time() >= until_s:
            return
        began_s = time.perf_counter()
        _get(connection, f"/api/v1/{read}", failed)
        taken.append((read, 1e3 * (time.perf_counter() - began_s)))


def _get(
    connection: http.client.HTTPConnection, path: str, failed: list[str], tags: dict[str, str] | None = None
) -> None:
    try:
        connection.request("GET", path, headers={"If-None-Match": tags[path]} if tags and path in tags else {})
        answer = connection.getresponse()
        answer.read()
        if tags is not None and (tag := answer.headers.get("etag")):
            tags[path] = tag
        if answer.status >= 400:
            failed.append(f"{path}: {answer.status}")
    except (OSError, http.client.HTTPException) as error:
        failed.append(f"{path}: {error}")
        connection.close()


# --- the system -----------------------------------------------------------------------------------------------------


class Search(NamedTuple):
    """One search: how long it took, and its steps [ms]."""

    seconds: float
    steps: int
    step_ms: np.ndarray


@contextlib.contextmanager
def running(building: str, perception: str) -> Iterator[tuple[int, str, int]]:
    """(the gateway's port, the router, the gateway's process) of a system that is ready."""
    port, router = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as logs:
        command = [
            str(Path(sys.executable).parent / "surveilnav"),
            "up",
            "--building",
            building,
            "--perception",
            perception,
            "--port",
            str(port),
            "--router",
            router,
            "--logs",
            f"{logs}/logs",
            "--record",
            "off",
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT) as up:
            assert up.stdout is not None
            for line in up.stdout:
                if line.startswith("ready"):
                    break
            else:
                raise SystemExit("the system didn't start")
            threading.Thread(target=up.stdout.read, daemon=True).start()
            try:
                yield port, router, _child(up.pid, "surveilnav.services.gateway")
            finally:
                up.terminate()


def _child(parent: int, module: str) -> int:
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError):
            if module in (folder / "cmdline").read_text() and folder.joinpath("stat").read_text().split()[3] == str(
                parent
            ):
                return int(folder.name)
    raise SystemExit(f"{module} isn't running")


def cpu_s(pid: int) -> float:
    """Processor seconds of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> float:
    """What it holds in memory."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def search(client: Client, node: Node, steps: int) -> Search:
    """A search for what isn't there, of so many steps: the same work each time."""
    robots, at_s = node.table(ROBOT_STATUS), dict[int, float]()
    began_s = time.perf_counter()
    mission = client.submit(NEVER_TARGET, None, steps)
    while not client.mission(mission.id).has_ended:
        until_s = time.perf_counter() + 0.5
        while time.perf_counter() < until_s:
            for row in robots.rows():
                at_s.setdefault(row.message.seq, time.perf_counter())
            time.sleep(0.002)
    times = [at_s[seq] for seq in sorted(at_s)]
    ended = client.mission(mission.id)
    return Search(time.perf_counter() - began_s, ended.step, 1e3 * np.diff(times))


#: A word that perception knows and the building hasn't.
NEVER_TARGET = "airplane"


def main(argv: Sequence[str] | None = None) -> None:
    """Searches by turns with and without load until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=300.0, help="under load, in all")
    parser.add_argument("--pages", type=int, default=20)
    parser.add_argument("--requests-hz", type=float, default=50.0)
    parser.add_argument("--building", default="2_bedroom")
    parser.add_argument("--perception", default="simulated")
    parser.add_argument("--steps", type=int, default=150, help="of a search")
    parser.add_argument("--load", nargs=5, metavar="X", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.load:
        port, pages, hz, tiles, until_s = args.load
        print(json.dumps(load(int(port), int(pages), float(hz), tiles, float(until_s))))
        return
    with (
        running(args.building, args.perception) as (port, router, gateway),
        Client(f"http://127.0.0.1:{port}") as client,
        Node("cli", "bench", BusSettings(router=router, building=_bus_name(client)), alive=False) as node,
    ):
        tiles = "&".join(f"of={c.id}/0" for c in client.cameras()[:6])
        search(client, node, args.steps)  # compiles and fills caches
        quiet = [search(client, node, args.steps) for _ in range(2)]
        until_s, before_s, memory = time.time() + args.seconds, cpu_s(gateway), [memory_mb(gateway)]
        command = [
            sys.executable,
            __file__,
            "--load",
            str(port),
            str(args.pages),
            str(args.requests_hz),
            tiles,
            str(until_s),
        ]
        loaded, began_s = [], time.time()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as asking:
            while time.time() < until_s - 5:
                loaded.append(search(client, node, args.steps))
                memory.append(memory_mb(gateway))
            told = json.loads(asking.communicate()[0])
        used = (cpu_s(gateway) - before_s) / (time.time() - began_s)
        quiet.append(search(client, node, args.steps))
    report(args, quiet, loaded, told, used, memory)


def _bus_name(client: Client) -> str:
    return str(client.buildings()[0].id)


def report(
    args: argparse.Namespace,
    quiet: list[Search],
    loaded: list[Search],
    told: dict[str, Any],
    used: float,
    memory: list[float],
) -> None:
    """Prints the table."""
    p50, p95, p99 = np.percentile([ms for _, ms in told["ms"]], [50, 95, 99])
    print(
        f"{args.pages} pages, {len(told['ms']) / args.seconds:.0f} reads/s for {args.seconds:.0f} s; {told['n_failed']} failed"
    )
    print(*told["failed"], sep="\n")
    print(f"a read: p50 {p50:.0f} ms, p95 {p95:.0f} ms, p99 {p99:.0f} ms")
    by_read = {read: np.percentile([ms for r, ms in told["ms"] if r == read], 95) for read in READS}
    print("p95 by what is read: " + ", ".join(f"{read} {ms:.0f}" for read, ms in by_read.items()))
    print(
        f"gateway: {100 * used:.0f} % of a core; memory {memory[0]:.0f} MB before, "
        + ", ".join(f"{m:.0f}" for m in memory[1:])
    )
    print(f"the load itself: {100 * told['cpu_s'] / args.seconds:.0f} % of a core")
    for name, rows in (("quiet", quiet), ("under load", loaded)):
        steps = np.concatenate([row.step_ms for row in rows])
        seconds = sorted(row.seconds / max(1, row.steps) for row in rows)
        print(
            f"{name}: {len(rows)} searches, a step {1e3 * float(np.median(seconds)):.0f} ms (median of searches); "
            f"p50 {np.percentile(steps, 50):.0f} ms, p99 {np.percentile(steps, 99):.0f} ms"
        )


if __name__ == "__main__":
    main()
