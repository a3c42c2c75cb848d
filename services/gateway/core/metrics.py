"""The state of the building as Prometheus metrics.

Labels are names of cameras, nodes, robots, workers and floors that announced themselves, at most ``MAX_THINGS`` of each
kind: somebody who invents names can't fill a database.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import Any, TypeVar, get_args

from prometheus_client import Metric
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily

from surveilnav.histogram import EDGES_MS
from surveilnav.messages import WorkerLoad
from surveilnav.mission_states import MissionStateName
from surveilnav.rest import (
    Camera,
    Floor,
    FloorCamera,
    Mission,
    NodeTraffic,
    Recorder,
    Robot,
    Service,
    SourceTraffic,
    Traffic,
)

T = TypeVar("T")
#: How many things of a kind have metrics at most.
MAX_THINGS = 1000
_MAX_STAGES = 12
#: Every fourth edge: a bucket for each doubling.
_EDGES = range(0, len(EDGES_MS), 4)


@dataclass(frozen=True, slots=True)
class BuildingMetrics:
    """The state that the metrics are made of; a collector for prometheus_client.

    ``workers`` has the newest load of each perception worker, and whether it is stale.
    """

    cameras: Sequence[Camera]
    floors: Sequence[Floor]
    robots: Sequence[Robot]
    missions: Sequence[Mission]
    processes: Sequence[Service]
    workers: Mapping[str, tuple[WorkerLoad, bool]]
    traffic: Traffic
    recorders: Sequence[Recorder]
    ready: bool
    event_streams: int
    events: int

    def collect(self) -> Iterator[Metric]:
        yield from _camera_metrics(self)
        yield from _floor_metrics(self)
        yield from _node_metrics(self)
        yield from _worker_metrics(self)
        yield from _robot_and_mission_metrics(self)
        yield from _recorder_metrics(self)
        yield from _system_metrics(self)


def _filled(
    family: Any,
    name: str,
    what: str,
    things: Iterable[T],
    labels: Callable[[T], dict[str, str]],
    value: Callable[[T], float | None],
) -> Metric:
    """A family with a sample for each thing that has a value."""
    rows = [(labels(t), v) for t in things if (v := value(t)) is not None]
    made = family(f"surveilnav_{name}", what, labels=list(rows[0][0]) if rows else [])
    for label, number in rows:
        made.add_metric(list(label.values()), number)
    return made  # type: ignore[no-any-return]


_gauge, _counter = partial(_filled, GaugeMetricFamily), partial(_filled, CounterMetricFamily)


def _camera_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    cameras = state.cameras[:MAX_THINGS]
    known = {c.id for c in cameras}
    sums = [s for s in state.traffic.cameras if s.id in known]
    yield _gauge("camera_up", "1: the camera is there", cameras, _camera, lambda c: not c.stale)
    yield _gauge(
        "camera_stream_live",
        "1: its stream brings pictures that show the present",
        cameras,
        _camera,
        lambda c: c.stream.state == "live",
    )
    what = "Bytes that came from the camera into its node, which aren't on the bus"
    yield _counter("camera_stream_bytes", what, cameras, _camera, lambda c: c.stream.n_bytes)
    yield _gauge("camera_invoked", "1: the maps of its floor ask it for views", cameras, _camera, lambda c: c.invoked)
    uses = [use for floor in state.floors for use in floor.invoked if use.camera in known]
    yield _gauge("camera_views_expected", "Views of an invoked camera", uses, _use, lambda u: u.views)
    yield _gauge("camera_views_processed", "How many of them the maps have", uses, _use, lambda u: u.views_processed)
    for name, what in (
        ("offered_bytes", "Bytes that the camera put"),
        ("delivered_bytes", "Bytes under its keys that others got"),
        ("frame_bytes", "Bytes of its frames, counted in offered"),
        ("frames", "Frames that it put"),
        ("replaced_bytes", "Bytes of its frames that arrived and were dropped unread, as a newer one came"),
        ("viewer_bytes", "Bytes of thumbnails for people, counted in offered"),
    ):
        yield _counter(f"camera_{name}", what, sums, _source, lambda s, name=name: getattr(s, name))  # type: ignore[misc]
    tiers = [(s.id, tier, n) for s in sums for tier, n in s.tier_bytes.items()]
    what = "Bytes of its frames that nobody has got"
    yield _gauge("camera_missing_bytes", what, sums, _source, lambda s: s.missing_bytes)
    what = "Bytes of its frames by tier"
    yield _counter("camera_tier_bytes", what, tiers, lambda t: {"camera": t[0], "tier": t[1]}, lambda t: t[2])
    what = "Bytes that the kernel counted on the camera's own sockets"
    yield _counter("camera_wire_bytes", what, sums, _source, lambda s: s.wire_sent_bytes)


def _floor_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    floors = state.floors[:MAX_THINGS]
    what = "Views on their way into the maps"
    yield _gauge("floor_pending_views", what, floors, lambda f: {"floor": f.id}, lambda f: f.pending_views)
    what = "1: perception answers"
    yield _gauge("floor_perception_ok", what, floors, lambda f: {"floor": f.id}, lambda f: f.perception_ok)


def _node_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    nodes = state.traffic.nodes[:MAX_THINGS]

    def labels(node: NodeTraffic) -> dict[str, str]:
        return {"kind": node.kind, "node": node.id}

    yield _gauge("node_stale", "1: no news of the node for too long", nodes, labels, lambda n: n.stale)
    what = "When the gateway last heard of the node (epoch)"
    yield _gauge(
        "node_last_seen_seconds", what, nodes, labels, lambda n: n.last_seen.timestamp() if n.last_seen else None
    )
    for name, what in (
        ("offered_bytes", "Bytes that the node put or asked"),
        ("delivered_bytes", "Bytes that it got"),
        ("wire_sent_bytes", "Bytes that the kernel counted as sent on its own sockets"),
        ("wire_received_bytes", "The same, received"),
    ):
        yield _counter(f"node_{name}", what, nodes, labels, lambda n, name=name: getattr(n, name))  # type: ignore[misc]
    what = "How far its clock is ahead of the gateway's"
    yield _gauge("node_clock_offset_seconds", what, nodes, labels, lambda n: n.clock_offset_s)
    what = "Frames that it never sent, as a newer picture came while they waited for budget or link"
    yield _counter("node_unsent", what, nodes, labels, lambda n: sum(n.unsent.values()))
    what = "What it dropped because it couldn't be read"
    yield _counter("node_rejected", what, nodes, labels, lambda n: sum(n.rejected.values()))


def _worker_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    workers = list(state.workers.items())[:MAX_THINGS]

    def labels(row: tuple[str, tuple[WorkerLoad, bool]]) -> dict[str, str]:
        return {"worker": row[0]}

    loads = [(id, load) for id, (load, _) in workers]
    up = "1: the worker is there, and its answer to a probe was well-formed"
    yield _gauge("perception_up", up, workers, labels, lambda r: r[1][0].ready and not r[1][1])
    yield _gauge("perception_queue", "Views that wait", workers, labels, lambda r: r[1][0].queued)
    yield _gauge("perception_queue_capacity", "How many can wait", workers, labels, lambda r: r[1][0].capacity)
    yield _counter("perception_cached", "Views whose answer was known", workers, labels, lambda r: r[1][0].cached)
    what = "How long views waited (queue) and took, by stage"
    times = HistogramMetricFamily("surveilnav_perception_seconds", what, labels=["worker", "stage"])
    for id, load in loads:
        for stage, counts in list(load.times.items())[:_MAX_STAGES]:
            if buckets := seconds_buckets(counts):
                times.add_metric([id, stage[:64]], buckets, None)
    yield times


def seconds_buckets(counts: Sequence[int]) -> list[tuple[str, float]]:
    """(upper edge [s], how many took at most that long), a bucket for each doubling and one for all; of counts by the
    buckets of ``EDGES_MS``, else none."""
    if len(counts) != len(EDGES_MS) + 1 or min(counts) < 0:
        return []
    sums = list(accumulate(counts))
    return [(f"{EDGES_MS[i] / 1000:.6g}", float(sums[i])) for i in _EDGES] + [("+Inf", float(sums[-1]))]


def _robot_and_mission_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    robots = state.robots[:MAX_THINGS]
    yield _gauge("robot_up", "1: the robot was heard of", robots, lambda r: {"robot": r.id}, lambda r: not r.stale)
    powered = [r for r in robots if r.battery is not None]
    what = "How full the robot's battery is, 0 to 1, if it says so"
    yield _gauge("robot_battery", what, powered, lambda r: {"robot": r.id}, lambda r: r.battery or 0.0)
    states = Counter(m.state for m in state.missions)
    what = "Missions by state, of those that are known"
    known = get_args(MissionStateName)
    yield _gauge("missions", what, known, lambda state: {"state": state}, lambda state: states[state])
    what = "Missions that ended at their target, of those that are known"
    yield _single("missions_found", what, sum(m.found for m in state.missions))


def _recorder_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    recorders = state.recorders[:MAX_THINGS]

    def labels(recorder: Recorder) -> dict[str, str]:
        return {"recorder": recorder.id}

    yield _gauge("recorder_up", "1: the recorder was heard of", recorders, labels, lambda r: not r.stale)
    what = "1: something isn't recorded that should be"
    yield _gauge("recorder_problem", what, recorders, labels, lambda r: r.problem is not None)
    yield _gauge(
        "recorder_recording", "Recordings that are being written", recorders, labels, lambda r: len(r.recording)
    )
    yield _gauge("recorder_bytes", "Bytes of all recordings", recorders, labels, lambda r: r.n_bytes)
    yield _gauge("recorder_free_bytes", "Bytes left on its disk", recorders, labels, lambda r: r.free_bytes)
    what = "Messages that its disk was too slow for"
    yield _counter("recorder_dropped", what, recorders, labels, lambda r: r.dropped)


def _system_metrics(state: BuildingMetrics) -> Iterator[Metric]:
    processes = state.processes[:MAX_THINGS]

    def labels(process: Service) -> dict[str, str]:
        return {"process": process.id}

    yield _gauge("process_running", "1: it runs", processes, labels, lambda p: p.running and not p.given_up)
    yield _counter("process_restarts", "How often it was started again", processes, labels, lambda p: p.restarts)
    yield _single("ready", "1: a mission could run now", state.ready)
    yield _single("event_streams", "Event streams that are open", state.event_streams)
    events = CounterMetricFamily("surveilnav_events", "Events since the gateway started")
    events.add_metric([], state.events)
    yield events


def _single(name: str, what: str, value: float) -> Metric:
    return GaugeMetricFamily(f"surveilnav_{name}", what, value=value)


def _camera(camera: Camera) -> dict[str, str]:
    return {"camera": camera.id, "floor": camera.floor}


def _use(use: FloorCamera) -> dict[str, str]:
    return {"camera": use.camera}


def _source(source: SourceTraffic) -> dict[str, str]:
    return {"camera": source.id}
