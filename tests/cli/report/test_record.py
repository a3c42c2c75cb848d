"""A run for programs: what ``run.json`` promises, and whose bytes are whose."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from surveilnav import contract
from surveilnav.cli.report.record import run_json, traffic_lines
from surveilnav.messages import TrafficReport, TrafficRow


def test_run_json_has_the_promised_members(record):
    facts = json.loads(json.dumps(run_json(record, Path("runs/1/report.html")), allow_nan=False))
    expected = {
        "found": True,
        "success": True,
        "steps": 42,
        "spl": 0.87,
        "path_m": 11.9,
        "shortest_path_m": 10.4,
        "seconds": 48.2,
        "perception": "onnx-coco",
        "cameras": 4,
        "invoked_cameras": ["c1", "c2", "c3"],
        "report": "runs/1/report.html",
        "traffic": {"offered": 43_802_100, "delivered": 64_790_900, "wire": 42_979_000},
    }
    assert {k: facts[k] for k in expected} == expected


def test_run_json_without_a_verdict_tells_what_the_mission_said(record):
    stuck = msgspec.structs.replace(record.status, state="failed", found=False, error="stuck", step=500, path_m=80.0)
    facts = run_json(replace(record, verdict={}, status=stuck, traffic=[]))
    assert (facts["found"], facts["success"], facts["steps"], facts["path_m"], facts["spl"]) == (
        False,
        False,
        500,
        80.0,
        None,
    )
    assert facts["error"] == "stuck"
    assert facts["traffic"] == {"offered": 0, "delivered": 0, "wire": None}
    json.dumps(
        run_json(replace(record, verdict={"spl": math.nan, "odd": np.float32(1), "worse": [math.inf, {1: object}]})),
        allow_nan=False,
    )


def test_traffic_lines_name_each_byte_once():
    frame = contract.CAMERA_FRAME.key_for(building="b", floor="0", camera="c1", view=0)
    reports = [
        TrafficReport(
            stamp_ns=1, node="c1", kind="camera", rows=[TrafficRow(frame, "offered", 1, 100)], wire_sent_bytes=120
        ),
        TrafficReport(stamp_ns=1, node="fusion", kind="fusion", rows=[TrafficRow(frame, "delivered", 1, 100)]),
        TrafficReport(stamp_ns=1, node="w1", kind="perception", rows=[]),
    ]
    assert traffic_lines(reports) == [
        ("c1", "camera", 100, 100, 120),
        ("fusion", "service", 0, 100, None),
        ("perception w1", "service", 0, 0, None),
    ]
