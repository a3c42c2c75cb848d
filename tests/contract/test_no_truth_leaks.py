"""Fusion and planner get pixels, depth and poses only: no message of theirs can carry ground truth."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import msgspec
import pytest

from surveilnav import contract
from surveilnav.messages import FrameHeader, InferReply, InferRequest, Observation

ROOT = Path(__file__).parents[2]

#: What a view may say of itself. A new field has to be justified here.
FRAME_FIELDS = {
    "stamp_ns",
    "source",
    "view",
    "seq",
    "floor",
    "T_world_camera",
    "camera",
    "mounting_offset_m",
    "depth_range_m",
    "image",
    "depth",
    "clock",
    "depth_source",
    "depth_uncertainty",
    "tier",
    "perceived",  # what the camera's own perception saw, as a worker's reply says it
    "scan",  # of a real robot's laser scanner
}
ODOMETRY_FIELDS = {"T_world_base", "last_action", "collided", "path_m"}


def fields(kind: type) -> set[str]:
    return {f.name for f in msgspec.structs.fields(kind)}


def test_frames_carry_pixels_depth_and_poses_only():
    assert fields(FrameHeader) == FRAME_FIELDS
    assert fields(Observation) == FRAME_FIELDS | ODOMETRY_FIELDS
    encodings = msgspec.json.schema(FrameHeader)["$defs"]["PayloadPart"]["properties"]["encoding"]["enum"]
    assert sorted(encodings) == ["depth-invq-zstd", "jpeg", "perceived-zstd", "png"]


def test_a_request_to_perception_carries_no_truth():
    assert fields(InferRequest) == {
        "stamp_ns",
        "source",
        "view",
        "seq",
        "camera",
        "image",
        "depth",
        "depth_range_m",
        "depth_source",
        "prompts",
        "texts",
        "deadline_ms",
        "detects",
        "asker",
        "handed",
        "cancel",
    }
    assert fields(InferReply) == {
        "stamp_ns",
        "worker",
        "backend",
        "source",
        "view",
        "seq",
        "detections",
        "image_embedding",
        "latency_ms",
        "relevance",
        "models",
        "words",
    }


#: Where instance ids pass: from a simulated source or body over the key to the backends that need them.
TRUTH_USERS = {
    "camera_node/simulated.py",
    "camera_node/sources/simulated.py",
    "camera_node/sources/source.py",
    "perception/truth_channel.py",
    "perception/core/probe.py",  # a backend that is told the truth is told that the probe shows nothing
    "perception/pending_request.py",
    "robot_node/bodies/simulated.py",
    "robot_node/simulated.py",
}
#: The gateway alone hears the simulator's verdict of a stop; its sums of traffic leave all of that out.
JUDGED_USERS = {"robot_node/verdicts.py", "gateway/state.py", "gateway/missions.py"}
SIMULATION_USERS = {"gateway/core/traffic.py"}
TRUTH_NAMES = {"TRUTH", "Truth", "TrueInstances", "truth_from_wire", "truth_to_wire", "truth_labels", "instance_ids"}


def truth_users(services: Path, secrets: frozenset[str] | set[str] = TRUTH_NAMES) -> set[str]:
    """Files of services that name the truth's key, message, array or codec, or other secrets."""
    users = set()
    for path in services.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        names = {n.id for n in nodes if isinstance(n, ast.Name)} | {
            n.attr for n in nodes if isinstance(n, ast.Attribute)
        }
        names |= {a.name for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names}
        if names & secrets:
            users.add(str(path.relative_to(services)))
    return users


def building_users(services: Path) -> set[str]:
    """Files of the services that must not know the building, and yet name the simulator."""
    return {
        str(path.relative_to(services))
        for service in ("fusion", "planner", "gateway", "perception")
        for path in (services / service).rglob("*.py")
        if re.search(r"\bsimulator\b\.|import simulator", path.read_text())
    }


def test_only_simulators_and_perception_name_the_truth():
    assert truth_users(ROOT / "services") == TRUTH_USERS
    assert {stream.owner for stream in contract.SIMULATION} == {"simulator nodes"}


def test_the_gateway_alone_hears_whether_a_stop_was_right():
    assert truth_users(ROOT / "services", {"JUDGED", "Judged"}) == JUDGED_USERS
    assert truth_users(ROOT / "services", {"SIMULATION"}) == SIMULATION_USERS


@pytest.mark.parametrize("stream", contract.SIMULATION, ids=lambda s: s.name)
def test_what_a_simulator_knows_travels_below_truth(stream):
    assert "/truth/" in stream.key
    assert "robot" not in stream.fields, "its bytes would count as the robot's"
    assert not any(
        s.ids_of(stream.key_for(**dict.fromkeys(stream.fields, "x"))) for s in contract.STREAMS if s is not stream
    )


def test_fusion_planner_and_gateway_cannot_import_the_building():
    """Perception's composition root registers the simulator's backends."""
    assert building_users(ROOT / "services") == {"perception/__main__.py"}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("fusion/durable_map.py", "from surveilnav.contract import TRUTH"),
        ("fusion/core/cloud.py", "def peek(contract): return contract.TRUTH"),
        ("planner/core/step.py", "from surveilnav.sensing.views import TrueInstances"),
        ("planner/world.py", "from surveilnav.sensing.truth import truth_from_wire"),
        ("perception/service.py", "labels = scene.truth_labels"),
    ],
)
def test_a_planted_leak_of_the_truth_is_seen(tmp_path, file, text):
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(text)
    assert truth_users(tmp_path) == {file}


@pytest.mark.parametrize(
    "text",
    ["from surveilnav.simulator.world.scene import Scene", "import simulator", "import surveilnav.simulator.world"],
)
def test_a_planted_import_of_the_building_is_seen(tmp_path, text):
    (tmp_path / "fusion/core").mkdir(parents=True)
    (tmp_path / "fusion/core/cloud.py").write_text(text)
    assert building_users(tmp_path) == {"fusion/core/cloud.py"}
