"""Who offered what, and who got it."""

from __future__ import annotations

import msgspec
import pytest

from surveilnav import __version__, contract
from surveilnav.messages import TrafficReport, TrafficRow
from surveilnav.services.gateway.core.traffic import ReportAge, sum_traffic

FRAME = contract.CAMERA_FRAME.key_for(building="b", floor="0", camera="c1", view=3)
SUMMARY = contract.CAMERA_SUMMARY.key_for(building="b", floor="0", camera="c1")
REQUEST = contract.CAMERA_REQUEST.key_for(building="b", floor="0", camera="c1")
OBSERVATION = contract.ROBOT_OBSERVATION.key_for(building="b", robot="r1")
COMMAND = contract.ROBOT_COMMAND.key_for(building="b", robot="r1")
TRUTH = contract.TRUTH.key_for(building="b", source="c1", view=3)


def report(
    kind: str,
    node: str,
    *rows: tuple[str, str, int, int],
    wire: int | None = None,
    stamp_ns: int = 1,
    release: str = "",
) -> TrafficReport:
    return TrafficReport(
        stamp_ns=stamp_ns,
        node=node,
        kind=kind,
        rows=[TrafficRow(*row) for row in rows],
        wire_sent_bytes=wire,  # type: ignore[arg-type]
        wire_received_bytes=None,
        release=release,
    )


REPORTS = [
    report(
        "camera",
        "c1",
        (FRAME, "offered", 2, 1000),
        (SUMMARY, "offered", 1, 100),
        (REQUEST, "offered", 1, 30),
        (REQUEST, "delivered", 1, 5),
        (TRUTH, "offered", 2, 7777),
        wire=1300,
    ),
    report("fusion", "f", (FRAME, "delivered", 2, 990), (OBSERVATION, "delivered", 1, 500), wire=10),
    report("gateway", "g", (SUMMARY, "delivered", 1, 100), (REQUEST, "offered", 1, 5), (REQUEST, "delivered", 1, 30)),
    report("planner", "p", (COMMAND, "offered", 1, 40), (COMMAND, "delivered", 1, 20), wire=50),
    report(
        "robot",
        "r1",
        (OBSERVATION, "offered", 1, 510),
        (COMMAND, "delivered", 1, 40),
        (COMMAND, "offered", 1, 20),
        wire=600,
    ),
]


def test_a_cameras_three_numbers():
    (camera,) = sum_traffic(REPORTS).cameras
    assert (camera.id, camera.node) == ("c1", "camera/c1")
    assert (camera.offered_bytes, camera.delivered_bytes, camera.wire_sent_bytes) == (1130, 1120, 1300)
    assert (camera.frame_bytes, camera.frames, camera.viewer_bytes) == (1000, 2, 30)
    assert camera.by_stream == {"camera_frame": 1000, "camera_summary": 100, "camera_request": 30}


def test_frames_that_nobody_read_are_known_by_reason():
    sender = msgspec.structs.replace(
        REPORTS[0],
        tier_bytes={"features": 400, "objects": 600, "[/invented]": 9},
        unsent={"link": 7, "[invented]": 8},
        stamp_ns=2,
    )
    readers = [
        report("fusion", "low", (FRAME, "delivered", 1, 300), (FRAME, "replaced", 1, 250), (REQUEST, "replaced", 1, 9)),
        report("fusion", "high", (FRAME, "delivered", 1, 50)),
    ]
    found = sum_traffic([sender, *readers])
    (camera,) = found.cameras
    assert camera.tier_bytes == {"features": 400, "objects": 600}
    assert (camera.frame_bytes, camera.replaced_bytes, camera.missing_bytes) == (1000, 250, 400)
    assert {node.id: node.unsent for node in found.nodes if node.unsent} == {"c1": {"link": 7}}


def test_what_was_counted_later_at_the_sender_isnt_less_than_nothing():
    (camera,) = sum_traffic([REPORTS[0], report("fusion", "f", (FRAME, "delivered", 3, 1500))]).cameras
    assert camera.missing_bytes == 0


def test_a_robots_three_numbers_leave_out_its_orders():
    (robot,) = sum_traffic(REPORTS).robots
    assert (robot.offered_bytes, robot.delivered_bytes, robot.frame_bytes, robot.wire_sent_bytes) == (
        530,
        520,
        510,
        600,
    )


def test_nodes_and_totals_leave_out_the_simulators_truth():
    sums = sum_traffic(REPORTS)
    nodes = {n.id: n for n in sums.nodes}
    assert (nodes["c1"].offered_bytes, nodes["c1"].simulation_bytes) == (1130, 7777)
    assert sums.offered_bytes == 1130 + 5 + 40 + 530
    assert sums.delivered_bytes == 5 + 1490 + 130 + 20 + 40
    assert sums.wire_sent_bytes == 1960


def test_links_add_up_to_what_was_offered():
    """The gateway's request of a picture goes to the camera, the planner's command to the robot."""
    reports = [*REPORTS, report("fusion", "f2", (contract.OBJECTS.key_for(building="b", floor="0"), "offered", 1, 90))]
    sums = sum_traffic(reports)
    links = sums.links
    assert (links.camera_bytes, links.robot_bytes, links.server_bytes) == (1130 + 5, 530 + 40, 90)
    assert links.simulation_bytes == 7777
    assert links.camera_bytes + links.robot_bytes + links.server_bytes == sums.offered_bytes


def test_the_newest_report_of_a_node_counts():
    old, new = (
        report("camera", "c1", (FRAME, "offered", 1, 1), stamp_ns=1),
        report("camera", "c1", (FRAME, "offered", 2, 2), stamp_ns=2),
    )
    assert sum_traffic([new, old]).cameras[0].offered_bytes == 2


def test_a_camera_whose_own_report_is_missing_isnt_its_askers():
    asker = report("fusion", "f", (FRAME, "delivered", 1, 9))
    (camera,) = sum_traffic([asker]).cameras
    assert (camera.node, camera.offered_bytes, camera.delivered_bytes, camera.wire_sent_bytes) == ("", 0, 9, None)


def test_nothing():
    sums = sum_traffic([])
    assert (sums.nodes, sums.cameras, sums.robots, sums.offered_bytes, sums.wire_sent_bytes) == ([], [], [], 0, None)


def test_a_clock_is_compared_with_the_gateways():
    hour_ns = 3600 * 10**9
    reports = [report("camera", "c1", stamp_ns=hour_ns + 5), report("robot", "r1", stamp_ns=7)]
    received = {"camera/c1": ReportAge(10, stale=False)}
    nodes = {n.id: n for n in sum_traffic(reports, received).nodes}
    assert nodes["c1"].clock_offset_s == pytest.approx(3600.0, abs=1e-3)
    assert nodes["r1"].clock_offset_s is None, "nobody knows when its report came"


def test_a_node_of_another_release_than_the_gateway_s_is_named():
    reports = [
        report("camera", "c1", release="0.0.9"),
        report("camera", "old"),
        report("robot", "r1", release=__version__),
    ]
    nodes = {n.id: (n.release, n.other_release) for n in sum_traffic(reports).nodes}
    assert nodes == {"c1": ("0.0.9", True), "old": ("", True), "r1": (__version__, False)}
