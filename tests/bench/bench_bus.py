"""What a congested link does to everybody else, by congestion control. Prints tables.

.venv/bin/python tests/bench/bench_bus.py [--runs 20] [--seconds 10] [--scenarios "healthy;frozen"] [--choices "shipped;block"]

Router, sender, readers and whoever commands are processes of their own, on one machine, over real Zenoh. The sender
puts frames of 1.5 MB ten times a second and a state fifty times a second, and answers commands. A choice is what the
bus's settings would be: ``shipped`` is what they are. Runs of all choices and scenarios alternate. A slow link is a
network namespace behind a token bucket: it needs Linux and root, and is left out, with the reason, elsewhere.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import zenoh

from surveilnav import contract
from surveilnav.bus import Answer, BusSettings, Node, Request, clock_ns, connection, logs, router
from surveilnav.bus.router import free_port
from surveilnav.bus.settings import router_config
from surveilnav.contract import CAMERA_FRAME, MAP_LAYER, MAP_REVISION, ROBOT_COMMAND, ROBOT_STATUS, Priority
from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Grid, Pinhole, Pose
from surveilnav.messages import Command, CommandReply, FrameHeader, LayerHeader, PayloadPart, Revision, RobotStatus

FRAME_BYTES, FRAMES_HZ, STATES_HZ, COMMANDS_HZ = 1_500_000, 10.0, 50.0, 50.0
#: Of a map: the cloud of a home.
LAYER_BYTES = 5_000_000
#: Where a reader is stopped, and goes on, as shares of a run.
FREEZE, THAW = 0.2, 0.8
HERE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
CAMERA = Pinhole(640, 480, 388.0, 388.0, 319.5, 239.5)
#: Cameras that send at the same moment, once a second.
BURST = 12


class Choice(NamedTuple):
    """Settings to compare: the congestion control of bulk data; waits [ms] at the clients and at the router.

    Where those are the shipped ones (``bulk`` is None): the congestion control of other priorities by ``full``, and with which
    priority map layers travel.
    """

    bulk: str | None = None
    client: dict[str, int] = {}
    router: dict[str, int] = {}
    lease_ms: int = 2000
    threads: int | None = None
    keep_alive: int = 4
    full: dict[Priority, str] = {}
    layers: Priority | None = None


_OWN = {"drop": 5000}
CHOICES = {
    "shipped": Choice(),
    "block": Choice("BLOCK"),
    "block, 8 threads": Choice("BLOCK", threads=8),
    "block, close 0.4 s, 8 threads": Choice("BLOCK", router={"close": 400}, threads=8),
    "block first": Choice("BLOCK_FIRST"),
    "block first, turn 0.1 s": Choice("BLOCK_FIRST", _OWN, {"drop": 100}),
    "block first, turn 0.1 s, lease 10 s": Choice("BLOCK_FIRST", _OWN, {"drop": 100}, lease_ms=10_000),
    "block first, turn 0.1 s, 8 threads, alive every 0.1 s": Choice(
        "BLOCK_FIRST", _OWN, {"drop": 100}, threads=8, keep_alive=20
    ),
    "block first, turn 0.1 s, 8 threads": Choice("BLOCK_FIRST", _OWN, {"drop": 100}, threads=8),
    "block first, turn 1 ms, 8 threads": Choice("BLOCK_FIRST", _OWN, {"drop": 1}, threads=8),
    "block first, turn 0.2 s, 8 threads": Choice("BLOCK_FIRST", _OWN, {"drop": 200}, threads=8),
    "drop": Choice("DROP"),
    "drop, parts 0.3 s": Choice("DROP", _OWN | {"fragments": 5000}, {"drop": 20, "fragments": 300}),
    "drop, parts 1 s": Choice("DROP", _OWN | {"fragments": 5000}, {"drop": 20, "fragments": 1000}),
    "control block first": Choice(full={"control": "BLOCK_FIRST"}),
    "control drop": Choice(full={"control": "DROP"}),
    "data block first": Choice(full={"data": "BLOCK_FIRST"}),
    "data drop": Choice(full={"data": "DROP"}),
    "layers as data, block": Choice(layers="data"),
    "layers as bulk, block first": Choice(layers="bulk"),
    "layers as bulk, drop": Choice(full={"bulk": "DROP"}, layers="bulk"),
}
_WAITS = {
    "drop": ("drop", "wait_before_drop"),
    "fragments": ("drop", "max_wait_before_drop_fragments"),
    "close": ("block", "wait_before_close"),
}


def tuned(config: str, waits_ms: dict[str, int], lease_ms: int, keep_alive: int = 4) -> str:
    """A Zenoh configuration with other waits and another lease."""
    made: dict[str, Any] = json.loads(config)
    sending = made["transport"]["link"]["tx"]
    sending["lease"] = lease_ms
    sending.pop("queue", None)  # ours
    sending["keep_alive"] = keep_alive
    for name, wait_ms in waits_ms.items():
        group, key = _WAITS[name]
        queue = sending.setdefault("queue", {}).setdefault("congestion_control", {})
        queue.setdefault(group, {})[key] = wait_ms * 1000
    return json.dumps(made)


class Tuned(BusSettings):
    """The bus's settings, but for a choice."""

    choice: str = "shipped"
    receive_buffer: int | None = None

    def client_config(self) -> str:
        choice, config = CHOICES[self.choice], super().client_config()
        if self.receive_buffer:  # loopback would take megabytes before it is full
            config = config.replace(self.router, f"{self.router}#so_rcvbuf={self.receive_buffer}")
        return config if choice.bulk is None else tuned(config, choice.client, choice.lease_ms)


# --- the roles: each a process, ended by SIGTERM, that prints what it saw as JSON -------------------------------------


def route(bus: Tuned) -> None:
    """The router."""
    choice, made = CHOICES[bus.choice], router_config
    if choice.bulk is not None:
        n = choice.threads
        os.environ["ZENOH_RUNTIME"] = f"(rx: (worker_threads: {n}), tx: (worker_threads: {n}))" if n else "()"
        router.router_config = lambda listen: tuned(made(listen), choice.router, choice.lease_ms, choice.keep_alive)
    router.main(["--listen", bus.router.replace("127.0.0.1", "0.0.0.0")])


def send(bus: Tuned) -> None:
    """Frames, states, answers to commands; prints the longest put of each, and how many were put."""
    with Node("robot", "r", bus, alive=False) as node:
        node.serve(ROBOT_COMMAND, lambda _: Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=0)), robot="r")
        states = node.publisher(ROBOT_STATUS, robot="r")

        def put_state(seq: int) -> None:
            states.put(
                RobotStatus(stamp_ns=clock_ns(), robot="r", floor="0", seq=seq, state="ready", T_world_base=HERE)
            )

        until_stopped(node, [Pace("frame", FRAMES_HZ, camera(node, "c")), Pace("state", STATES_HZ, put_state)])


def burst(bus: Tuned) -> None:
    """As many cameras as ``BURST``, each with a session of its own, that put a frame at the same moments."""
    with contextlib.ExitStack() as stack:
        nodes = [stack.enter_context(Node("camera_node", f"c{k}", bus, alive=False)) for k in range(BURST)]
        together = threading.Barrier(BURST)
        puts = [camera(node, node.id) for node in nodes]
        paces = [Pace("frame", 1.0, lambda seq, put=put: (together.wait(), put(seq))) for put in puts]
        node = stack.enter_context(Node("robot", "r", bus, alive=False))
        node.serve(ROBOT_COMMAND, lambda _: Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=0)), robot="r")
        until_stopped(node, paces, together)


class Pace(NamedTuple):
    """Something put at a rate; ``put`` gets its number."""

    what: str
    rate_hz: float
    put: Callable[[int], Any]


def camera(node: Node, name: str) -> Callable[[int], None]:
    """What puts a camera's frame of that number."""
    frames, picture = node.publisher(CAMERA_FRAME, floor="0", camera=name, view=0), bytes(FRAME_BYTES)

    def put(seq: int) -> None:
        header = FrameHeader(
            stamp_ns=clock_ns(),
            source=f"camera/{name}",
            view=0,
            seq=seq,
            floor="0",
            T_world_camera=HERE,
            camera=CAMERA,
            mounting_offset_m=2.4,
            depth_range_m=(0.5, 5.0),
            image=PayloadPart("jpeg", FRAME_BYTES),
            depth=PayloadPart("depth-invq-zstd", 0),
        )
        frames.put(header, picture)

    return put


def until_stopped(node: Node, paces: Sequence[Pace], together: threading.Barrier | None = None) -> None:
    """Puts at those paces, each on a thread, until SIGTERM. Who is late leaves out what it missed."""
    took_s: dict[str, list[float]] = {pace.what: [] for pace in paces}

    def keep_putting(pace: Pace) -> None:
        due_s = time.monotonic()
        for seq in itertools.count():
            begin_s = time.monotonic()
            try:
                pace.put(seq)
            except threading.BrokenBarrierError:
                return
            took_s[pace.what].append(time.monotonic() - begin_s)
            due_s = max(due_s + 1 / pace.rate_hz, time.monotonic() - 1.0)
            if node.stopping.wait(max(0.0, due_s - time.monotonic())):
                return

    threads = [threading.Thread(target=keep_putting, args=(pace,), daemon=True) for pace in paces]
    signal.signal(signal.SIGTERM, lambda *_: node.stop())
    for thread in threads:
        thread.start()
    said("ready")
    node.stopping.wait()
    if together:
        together.abort()
    for thread in threads:
        thread.join(6.0)
    said({what: {"n": len(took), "longest_s": max(took)} for what, took in took_s.items()})


def maps(bus: Tuned) -> None:
    """Answers questions for layers as fusion does, says ten times a second that the maps changed, answers commands."""
    layer, grid = bytes(LAYER_BYTES), Grid(0.0, 0.0, 0.05, 1, 1)

    def answer(request: Request) -> Answer:
        header = LayerHeader(
            stamp_ns=clock_ns(), floor="0", layer="cloud", revision=1, grid=grid, dtype="float32", shape=(0, 6)
        )
        return Answer(header, layer)

    with Node("fusion", "f", bus, alive=False) as node:
        node.serve(ROBOT_COMMAND, lambda _: Answer(CommandReply(stamp_ns=clock_ns(), accepted=True, seq=0)), robot="r")
        node.serve(MAP_LAYER, answer, workers=3)
        revisions = node.publisher(MAP_REVISION, floor="0")

        def put_revision(seq: int) -> None:
            revisions.put(
                Revision(
                    stamp_ns=clock_ns(), floor="0", revision=seq, floor_z_m=0.0, robots={}, cameras=[], pending_views=0
                )
            )

        until_stopped(node, [Pace("frame", FRAMES_HZ, put_revision)])


def look(bus: Tuned) -> None:
    """Asks for a layer ten times a second and hears of changes; prints when each came, and how often none did."""
    came_s: list[float] = []
    lost_s: list[float] = []
    seqs: list[int] = []
    with Node("gateway", "g", bus, alive=False) as node:
        node.subscribe(MAP_REVISION, lambda received: seqs.append(received.message.revision), floor="0")
        signal.signal(signal.SIGTERM, lambda *_: node.stop())
        said("ready")
        while not node.stopping.wait(0.0 if bus.receive_buffer else 0.1):
            try:
                node.ask(MAP_LAYER, floor="0", layer="cloud")
                came_s.append(time.monotonic())
            except SurveilNavError:
                lost_s.append(time.monotonic())
        said({"frames_s": came_s, "states": seqs, "lost_s": lost_s})


def read(bus: Tuned) -> None:
    """Takes every frame and every state; prints when each came, and the states' numbers."""
    came_s: list[float] = []
    seqs: list[int] = []
    with Node("reader", "x", bus, alive=False) as node:
        node.subscribe(CAMERA_FRAME, lambda _: came_s.append(time.monotonic()), floor="0", view=0)
        node.subscribe(ROBOT_STATUS, lambda received: seqs.append(received.message.seq), robot="r")
        signal.signal(signal.SIGTERM, lambda *_: node.stop())
        said("ready")
        node.stopping.wait()
        said({"frames_s": came_s, "states": seqs})


def said(what: Any) -> None:
    print(json.dumps(what), flush=True)


ROLES = {"route": route, "send": send, "burst": burst, "read": read, "maps": maps, "look": look}


# --- a run ------------------------------------------------------------------------------------------------------------


@dataclass
class Run:
    """What one run showed. Times in seconds."""

    silent_s: float
    put_s: float
    state_put_s: float
    offered: int
    delivered: int
    other: int | None
    states_lost: int
    commands_s: list[float] = field(default_factory=list)
    unanswered: int = 0
    layers_lost: int = 0


class Role:
    """A process that plays a role."""

    def __init__(
        self,
        name: str,
        bus: BusSettings,
        choice: str,
        inside: tuple[str, ...] = (),
        host: str = "",
        env: Mapping[str, str] = {},
    ) -> None:
        endpoint = bus.router.replace("127.0.0.1", host) if host else bus.router
        command = [*inside, sys.executable, __file__, "--role", name, "--choice", choice]
        env = os.environ | {"SURVEILNAV_BUS__ROUTER": endpoint, "SURVEILNAV_BUS__LOG_LEVEL": "error", **env}
        quiet = None if os.environ.get("BENCH_LOUD") else subprocess.DEVNULL
        self.process = subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=quiet, text=True)
        if name != "route":
            self.line()

    def line(self) -> Any:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline() or "null")

    def end(self) -> Any:
        """Ends it; what it saw."""
        self.process.send_signal(signal.SIGCONT)
        self.process.terminate()
        seen = self.line()
        try:
            self.process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        return seen


def commands(bus: Tuned, until_s: float) -> tuple[list[float], int]:
    """How long each command took [s], and how many got no answer."""
    took_s, unanswered, seq = [], 0, 0
    with Node("planner", "p", bus, alive=False) as node:
        while time.monotonic() < until_s:
            begin_s = time.monotonic()
            seq += 1
            try:
                node.ask(ROBOT_COMMAND, command(seq), robot="r", timeout_s=10.0)
                took_s.append(time.monotonic() - begin_s)
            except SurveilNavError:
                unanswered += 1
            time.sleep(max(0.0, begin_s + 1 / COMMANDS_HZ - time.monotonic()))
    return took_s, unanswered


def command(seq: int) -> Command:
    return Command(stamp_ns=clock_ns(), action="stop", seq_expected=seq)


def play(scenario: str, choice: str, seconds: float, link: Link | None) -> Run:
    """One run: everybody starts, a reader is frozen or behind a slow link, everybody ends."""
    bus = Tuned(router=f"tcp/127.0.0.1:{free_port()}", choice=choice)
    inside, host = (link.inside, link.host) if link else ((), "")
    roles: list[Role] = []

    def start(name: str, slow: bool = False, **env: str) -> Role:
        roles.append(Role(name, bus, choice, inside if slow else (), host if slow else "", env))
        return roles[-1]

    try:
        start("route")
        reads, frozen = ("look" if "looks" in scenario else "read"), scenario.startswith("frozen")
        if reads == "look":
            sender = start("maps")
        healthy = start(reads)
        buffer = {"SURVEILNAV_BUS__RECEIVE_BUFFER": "262144"} if frozen else {}
        slow = scenario.startswith("slow reader")
        other = start(reads, slow, **buffer) if frozen or slow else None
        if reads == "read":
            sender = start("burst" if scenario == "burst" else "send", slow=scenario == "slow sender")
        time.sleep(0.5)
        begin_s = time.monotonic()
        if frozen:
            assert other is not None
            for share, number in ((FREEZE, signal.SIGSTOP), (THAW, signal.SIGCONT)):
                threading.Timer(share * seconds, other.process.send_signal, (number,)).start()
        took_s, unanswered = commands(bus, begin_s + seconds)
        end_s = time.monotonic()
        put = sender.end()
        time.sleep(0.3)
        came, other_came = healthy.end(), other.end() if other else None
    finally:
        for role in roles:
            if role.process.poll() is None:
                role.process.kill() if role.process is not roles[0].process else role.end()
    return outcome(came, other_came, put, (begin_s, end_s), took_s, unanswered)


def outcome(came: Any, other: Any, put: Any, span_s: tuple[float, float], took_s: list[float], unanswered: int) -> Run:
    begin_s, end_s = span_s
    within = [begin_s, *(s for s in came["frames_s"] if begin_s < s < end_s), end_s]
    states = came["states"]
    return Run(
        silent_s=max(b - a for a, b in itertools.pairwise(within)),
        put_s=put["frame"]["longest_s"] if put else float("nan"),
        state_put_s=put["state"]["longest_s"] if put and "state" in put else float("nan"),
        offered=put["frame"]["n"] if put else -1,
        delivered=len(came["frames_s"]),
        other=None if other is None else len(other["frames_s"]),
        states_lost=states[-1] - states[0] + 1 - len(set(states)) if states else 0,
        commands_s=took_s,
        unanswered=unanswered,
        layers_lost=sum(begin_s < s < end_s for s in came.get("lost_s", [])),
    )


# --- a slow link ------------------------------------------------------------------------------------------------------


class Link(NamedTuple):
    """A network namespace behind a slow link: how a command is run inside, and the router's address from there."""

    inside: tuple[str, ...]
    host: str


@contextlib.contextmanager
def slow_link(rate: str) -> Iterator[Link | None]:
    """A namespace whose only way out has ``rate`` (``10mbit``) in both directions; None, and the reason printed, where
    this machine can't have one."""
    name = f"slow{os.getpid()}"
    outer, inner, host = f"o{os.getpid()}", f"i{os.getpid()}", f"10.231.{os.getpid() % 250}"
    shape = f"tbf rate {rate} burst 32kb latency 200ms"
    try:
        for line in (
            f"ip netns add {name}",
            f"ip link add {outer} type veth peer name {inner} netns {name}",
            f"ip addr add {host}.1/24 dev {outer}",
            f"ip link set {outer} up",
            f"ip -n {name} addr add {host}.2/24 dev {inner}",
            f"ip -n {name} link set {inner} up",
            f"ip -n {name} link set lo up",
            f"tc qdisc add dev {outer} root {shape}",
            f"tc -n {name} qdisc add dev {inner} root {shape}",
        ):
            subprocess.run(line.split(), check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"slow links are left out: {getattr(error, 'stderr', None) or error}", file=sys.stderr)
        yield None
    else:
        yield Link(("ip", "netns", "exec", name), f"{host}.1")
    finally:
        subprocess.run(["ip", "netns", "del", name], capture_output=True)
        subprocess.run(["ip", "link", "del", outer], capture_output=True)


# --- tables -----------------------------------------------------------------------------------------------------------

SCENARIOS = {
    "healthy": "A healthy link",
    "burst": f"{BURST} cameras at the same moments, a healthy link",
    "frozen": "One of two readers is frozen",
    "looks": "One asks for a layer of the map again and again, a healthy link",
    "frozen looks": "One of two that ask for layers is frozen",
    "slow reader": "One of two readers has a slow link",
    "slow reader looks": "One of two that ask for layers has a slow link",
    "slow sender": "The sender has a slow link",
}
HEAD = (
    "| choice | runs | longest silence s, median / most | longest put s, frame / state | frames, of those put "
    "| frames at the other reader | states lost | commands ms, p50 / p99 / most | unanswered | layers lost |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def row(choice: str, runs: list[Run]) -> str:
    """A line of the table, over all runs of a choice."""
    silent = [run.silent_s for run in runs]
    took_ms = np.concatenate([run.commands_s for run in runs]) * 1e3
    p50, p99, most = np.quantile(took_ms, [0.5, 0.99, 1.0]) if took_ms.size else (np.nan,) * 3
    others = [run.other for run in runs if run.other is not None]
    other = f"{np.mean(others):.0f}" if others else ""
    return (
        f"| {choice} | {len(runs)} | {np.median(silent):.2f} / {max(silent):.2f} "
        f"| {max(run.put_s for run in runs):.2f} / {max(run.state_put_s for run in runs):.2f} "
        f"| {sum(run.delivered for run in runs)} of {sum(run.offered for run in runs)} | {other} "
        f"| {sum(run.states_lost for run in runs)} | {p50:.1f} / {p99:.1f} / {most:.0f} "
        f"| {sum(run.unanswered for run in runs)} | {sum(run.layers_lost for run in runs)} |"
    )


def choose(choice: Choice) -> None:
    """Has this process send as the choice says."""
    for priority, name in ({"bulk": choice.bulk} if choice.bulk else choice.full).items():
        contract.WHEN_FULL[priority] = name  # type: ignore[assignment, index]
        connection.CONGESTION[name] = getattr(zenoh.CongestionControl, name)
    if choice.layers:
        object.__setattr__(MAP_LAYER, "priority", choice.layers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each choice in each scenario")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run")
    parser.add_argument("--rate", default="10mbit", help="of a slow link, as tc writes it")
    parser.add_argument("--scenarios", default="", help=f"between semicolons: {'; '.join(SCENARIOS)}; all if left out")
    parser.add_argument("--choices", default="", help="names between semicolons; all if left out")
    parser.add_argument("--role", choices=ROLES, help=argparse.SUPPRESS)
    parser.add_argument("--choice", default="shipped", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role:
        choose(CHOICES[arguments.choice])
        logs.configure()
        ROLES[arguments.role](Tuned(choice=arguments.choice))
        return
    compared = arguments.choices.split(";") if arguments.choices else list(CHOICES)
    scenarios = arguments.scenarios.split(";") if arguments.scenarios else list(SCENARIOS)
    with slow_link(arguments.rate) if any("slow" in name for name in scenarios) else contextlib.nullcontext() as link:
        scenarios = [name for name in scenarios if link or "slow" not in name]
        runs: dict[tuple[str, str], list[Run]] = {pair: [] for pair in itertools.product(scenarios, compared)}
        for _ in range(arguments.runs):
            for (scenario, choice), played in runs.items():
                played.append(play(scenario, choice, arguments.seconds, link if "slow" in scenario else None))
                print(f"{scenario}: {row(choice, played[-1:])}", file=sys.stderr, flush=True)
    for scenario in scenarios:
        print(f"\n### {SCENARIOS[scenario]}\n\n{HEAD}")
        for choice in compared:
            print(row(choice, runs[scenario, choice]), flush=True)


if __name__ == "__main__":
    main()
