"""Metrics: what is counted, by whom, and that strangers can't make more of them."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from surveilnav.histogram import EDGES_MS, Histogram
from surveilnav.messages import WorkerLoad
from surveilnav.rest import Camera, Floor, Mission, NodeTraffic, Service, SourceTraffic, Traffic
from surveilnav.services.gateway.core import metrics
from surveilnav.services.gateway.core.metrics import BuildingMetrics, seconds_buckets

COUNTS = {"offered_bytes": 5, "delivered_bytes": 4, "frame_bytes": 3, "frames": 1, "viewer_bytes": 2, "by_stream": {}}


def camera(id: str, **facts) -> Camera:
    known = {
        "id": id,
        "floor": "0",
        "position_m": (0, 0, 0),
        "mounting_offset_m": 2.0,
        "hfov_rad": 1.0,
        "width_px": 1,
        "height_px": 1,
        "tier": "jpeg+depth",
        "stream": {"state": "live", "reason": "", "since": None, "n_bytes": 8},
        "paused": False,
        "invoked": True,
        "views": [],
        "stale": False,
    }
    return Camera.model_validate(known | facts)


def source(id: str, wire: int | None = 6) -> SourceTraffic:
    return SourceTraffic(id=id, node=f"camera/{id}", wire_sent_bytes=wire, stale=False, **COUNTS)


def metrics_of(**facts) -> BuildingMetrics:
    known = {
        "cameras": [],
        "floors": [],
        "robots": [],
        "missions": [],
        "processes": [],
        "recorders": [],
        "workers": {},
        "ready": True,
        "event_streams": 2,
        "events": 3,
    }
    cameras = facts.pop("sources", [])
    nodes = facts.pop("nodes", [])
    traffic = Traffic(offered_bytes=0, delivered_bytes=0, wire_sent_bytes=None, nodes=nodes, cameras=cameras, robots=[])
    return BuildingMetrics(**(known | {"traffic": traffic} | facts))


def samples(of: BuildingMetrics) -> dict[tuple[str, ...], float]:
    """Value by name and labels, as a scraper reads them."""
    families = text_string_to_metric_families(generate_latest(of).decode())
    found = [s for family in families for s in family.samples]
    told = {(s.name.removeprefix("surveilnav_"), *s.labels.values()): s.value for s in found}
    assert len(told) == len(found)
    return told


def test_a_camera_has_its_three_numbers_and_its_views():
    floor = Floor(
        id="0",
        z_m=0.0,
        revision=1,
        robots=[],
        cameras=["c1"],
        layers={},
        stale=False,
        pending_views=4,
        invoked=[{"camera": "c1", "views_processed": 7, "views": 13}],
    )
    told = samples(metrics_of(cameras=[camera("c1"), camera("c2", stale=True)], sources=[source("c1")], floors=[floor]))
    assert told["camera_offered_bytes_total", "c1"] == 5
    assert told["camera_delivered_bytes_total", "c1"] == 4
    assert told["camera_wire_bytes_total", "c1"] == 6
    assert (told["camera_views_expected", "c1"], told["camera_views_processed", "c1"]) == (13, 7)
    assert (told["camera_up", "c1", "0"], told["camera_up", "c2", "0"]) == (1, 0)
    assert told["camera_stream_live", "c1", "0"] == 1
    assert told["camera_stream_bytes_total", "c1", "0"] == 8
    assert told["floor_pending_views", "0"] == 4


def test_what_nobody_knows_has_no_sample():
    told = samples(metrics_of(cameras=[camera("c1")], sources=[source("c1", wire=None)]))
    assert ("camera_wire_bytes_total", "c1") not in told


def test_only_cameras_that_announced_themselves_and_not_too_many_have_labels(monkeypatch):
    monkeypatch.setattr(metrics, "MAX_THINGS", 3)
    cameras = [camera(f"c{i}") for i in range(9)]
    told = samples(metrics_of(cameras=cameras, sources=[source(f"c{i}") for i in range(9)] + [source("stranger")]))
    assert {key[1] for key in told if key[0].startswith("camera_")} == {"c0", "c1", "c2"}


def test_stale_nodes_missions_and_restarts():
    common = {"offered_messages": 1, "delivered_messages": 1, "simulation_bytes": 0, "wire_received_bytes": None}
    node = NodeTraffic(
        id="f1",
        kind="fusion",
        offered_bytes=1,
        delivered_bytes=2,
        wire_sent_bytes=3,
        rejected={"a": 2, "b": 3},
        stale=True,
        last_seen=datetime.fromtimestamp(1_700_000_000, UTC),
        **common,
    )
    missions = [
        Mission(id=str(i), target="tv", robot="r", state=s, stale=False, found=s == "done")
        for i, s in enumerate(["done", "done", "failed", "active"])
    ]
    process = Service.model_validate(
        {
            "id": "fusion",
            "running": True,
            "restarts": 4,
            "restarted": None,
            "why": "",
            "given_up": True,
            "stale": False,
        }
    )
    told = samples(metrics_of(nodes=[node], missions=missions, processes=[process]))
    assert told["node_stale", "fusion", "f1"] == 1
    assert told["node_last_seen_seconds", "fusion", "f1"] == 1_700_000_000
    assert told["node_rejected_total", "fusion", "f1"] == 5
    assert ("node_wire_received_bytes_total", "fusion", "f1") not in told
    assert [told["missions", s] for s in ("done", "failed", "active", "queued", "cancelled")] == [2, 1, 1, 0, 0]
    assert (told["missions_found",], told["ready",], told["events_total",]) == (2, 1, 3)
    assert (told["process_restarts_total", "fusion"], told["process_running", "fusion"]) == (4, 0)


@given(st.lists(st.floats(0.01, 1e6), max_size=40))
def test_buckets_count_what_took_at_most_so_long(durations_ms):
    histogram = Histogram()
    for duration_ms in durations_ms:
        histogram.add(duration_ms)
    buckets = seconds_buckets(histogram.counts)
    assert buckets[-1] == ("+Inf", len(durations_ms))
    for edge, count in buckets[:-1]:
        assert count == sum(d <= float(edge) * 1000 * (1 + 1e-6) for d in durations_ms)


@pytest.mark.parametrize("counts", [[], [1], [1] * 99, [-1] + [1] * len(EDGES_MS)])
def test_counts_that_are_none_are_left_out(counts):
    load = WorkerLoad(
        stamp_ns=1, worker="w", backend="b", why="", queued=2, capacity=8, latency_ms=1.0, times={"x": counts}
    )
    told = samples(metrics_of(workers={"w": (load, False)}))
    assert told["perception_queue", "w"] == 2
    assert not [key for key in told if key[0].startswith("perception_seconds")]


def test_times_of_a_worker():
    load = WorkerLoad(
        stamp_ns=1,
        worker="w",
        backend="b",
        why="",
        queued=0,
        capacity=8,
        latency_ms=1.0,
        times={f"stage{i}": [0] * 20 + [3] + [0] * (len(EDGES_MS) - 20) for i in range(50)},
    )
    told = samples(metrics_of(workers={"w": (load, True)}))
    assert told["perception_seconds_bucket", "0.008", "stage0", "w"] == 3
    assert told["perception_seconds_bucket", "0.004", "stage0", "w"] == 0
    assert (
        len({key[2] for key in told if key[0] == "perception_seconds_bucket"}) == 12
    )  # names of stages are a stranger's
    assert told["perception_up", "w"] == 0
