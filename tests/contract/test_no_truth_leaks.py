"""Fusion and planner get pixels, depth and poses only: no message of theirs can carry ground truth."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import msgspec

from surveilnav import contract
from surveilnav.messages import FrameHeader, InferReply, InferRequest, Observation

ROOT = Path(__file__).parents[2]

#: What a view may say of itself. A new field has to be justified here.
FRAME_FIELDS = {
    "stamp_ns", "source", "view", "seq", "floor", "T_world_camera", "camera", "mounting_offset_m", "depth_range_m",
    "image", "depth",
}  # fmt: skip
ODOMETRY_FIELDS = {"T_world_base", "last_action", "collided", "path_m"}


def fields(kind: type) -> set[str]:
    return {f.name for f in msgspec.structs.fields(kind)}


def test_frames_carry_pixels_depth_and_poses_only():
    assert fields(FrameHeader) == FRAME_FIELDS
    assert fields(Observation) == FRAME_FIELDS | ODOMETRY_FIELDS
    encodings = msgspec.json.schema(FrameHeader)["$defs"]["Part"]["properties"]["encoding"]["enum"]
    assert sorted(encodings) == ["depth-invq-zstd", "jpeg"]


def test_a_request_to_perception_carries_no_truth():
    assert fields(InferRequest) == {
        "stamp_ns", "source", "view", "seq", "camera", "image", "depth", "depth_range_m", "prompts", "texts", "deadline_ms",
    }  # fmt: skip
    assert fields(InferReply) == {
        "stamp_ns", "worker", "backend", "source", "view", "seq", "detections", "image_embedding", "latency_ms",
    }  # fmt: skip


def test_only_simulators_and_perception_name_the_truth_key():
    users = set()
    for path in (ROOT / "services").rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        names = {n.id for n in nodes if isinstance(n, ast.Name)} | {
            n.attr for n in nodes if isinstance(n, ast.Attribute)
        }
        names |= {a.name for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names}
        if "TRUTH" in names and path.name != "traffic.py":  # the gateway's sums leave the key out
            users.add(path.relative_to(ROOT / "services").parts[0])
    assert users <= {"camera_node", "robot_node", "perception"}
    assert contract.TRUTH.owner == "simulator nodes"


def test_fusion_and_planner_cannot_import_the_building():
    for service in ("fusion", "planner", "gateway", "perception"):
        for path in (ROOT / "services" / service).rglob("*.py"):
            text = path.read_text()
            if path.name != "__main__.py":  # composition roots register the simulator's perception
                assert not re.search(r"\bsimulator\b\.|import simulator", text), (
                    f"{path}: the building is the simulator's alone"
                )
