"""A node on a real router: newest wins, bounded queues, errors with names, hostile bytes dropped, bytes counted."""

from __future__ import annotations

import threading
import time

import pytest
import zenoh

from surveilnav.bus import Answer, BusSettings, Node, Refused, Unanswered
from surveilnav.bus.router import free_port, open_router
from surveilnav.contract import MISSION_CANCEL, MISSION_GOAL, ROBOT_OBSERVATION, ROBOT_STATUS, TRUTH, schema_of
from surveilnav.errors import BusError
from surveilnav.geometry import Pose
from surveilnav.messages import Command, MissionAck, MissionGoal, RobotStatus, Truth

POSE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def eventually(condition, timeout_s=5.0):
    """Waits for what other threads bring about; the last value."""
    until = time.monotonic() + timeout_s
    while not (value := condition()) and time.monotonic() < until:
        time.sleep(0.01)
    return value


def status(seq=0, robot="r1"):
    return RobotStatus(stamp_ns=1, robot=robot, floor="0", seq=seq, state="ready", T_world_base=POSE)


def truth(seq):
    return Truth(stamp_ns=1, source="robot/r1", view=0, seq=seq, width_px=1, height_px=1, labels={})


def test_a_slot_keeps_only_the_newest(make_node):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher = sender.publisher(TRUTH, source="robot-r1", view=0)
    assert not publisher.matched
    slot = receiver.slot(TRUTH, source="robot-r1", view=0)
    assert eventually(lambda: publisher.matched)
    for seq in range(20):
        publisher.put(truth(seq), b"x" * 100_000)
    time.sleep(0.3)
    received = slot.poll()
    assert received.message.seq == 19
    assert len(received.payload) == 100_000
    assert received.ids["source"] == "robot-r1"
    assert slot.poll() is None
    slot.close()
    assert eventually(lambda: not publisher.matched)


def test_a_table_holds_what_was_put_before_and_after(make_node):
    owner, reader = make_node("robot", "r1"), make_node("b", "b")
    owner.serve(ROBOT_STATUS, lambda _: Answer(status(3)), robot="r1")
    table = reader.table(ROBOT_STATUS)
    assert table.get(robot="r1").message.seq == 3
    publisher = owner.publisher(ROBOT_STATUS, robot="r1")
    publisher.put(status(4))
    assert eventually(lambda: table.get(robot="r1").message.seq == 4)
    assert table.get(robot="r2") is None
    assert table.rows(max_age_s=0) == []


def test_a_query_is_answered_refused_or_unanswered(make_node):
    planner, client = make_node("planner", "p"), make_node("cli", "c")

    def on_goal(request):
        if request.message.target == "unicorn":
            raise Refused("bad_target", "there are no unicorns")
        if request.message.target == "bug":
            raise ZeroDivisionError("oops")
        return Answer(MissionAck(stamp_ns=1, mission=request.ids["mission"], accepted=True, state="queued"))

    planner.serve(MISSION_GOAL, on_goal)
    ask = lambda target: client.ask(MISSION_GOAL, MissionGoal(stamp_ns=1, mission="m", target=target), mission="m")  # noqa: E731
    assert eventually(lambda: ask("tv")).message.accepted
    with pytest.raises(Refused, match="no unicorns") as refused:
        ask("unicorn")
    assert refused.value.name == "bad_target"
    with pytest.raises(Refused, match="ZeroDivisionError") as refused:
        ask("bug")
    assert refused.value.name == "internal"
    assert ask("tv").message.accepted  # a handler's bug ends nothing
    with pytest.raises(Unanswered, match="nobody is there"):
        client.ask(MISSION_CANCEL, MissionGoal(stamp_ns=1, mission="m", target="tv"), mission="m")


def test_a_full_queue_refuses_at_once(make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    release = threading.Event()

    def slow(request):
        release.wait(10)
        return Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued"))

    server.serve(MISSION_GOAL, slow, capacity=1)
    goal = MissionGoal(stamp_ns=1, mission="m", target="tv")
    answers = []

    def ask():
        try:
            answers.append(client.ask(MISSION_GOAL, goal, mission="m", timeout_s=10).message.accepted)
        except Refused as error:
            answers.append(error.name)

    time.sleep(0.2)
    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
        time.sleep(0.1)
    assert eventually(lambda: answers.count("busy") == 2)
    release.set()
    for thread in threads:
        thread.join()
    assert sorted(map(str, answers)) == ["True", "True", "busy", "busy"]


def test_parameters_survive_spaces_and_semicolons(make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    seen = []

    def answer(request):
        seen.append(request.parameters)
        return Answer(status())

    server.serve(ROBOT_STATUS, answer, robot="r1")
    parameters = {"target": "potted plant; x=1 & ä", "n": "2"}
    assert eventually(lambda: client.ask(ROBOT_STATUS, robot="r1", parameters=parameters))
    assert seen[0] == parameters


HOSTILE = [
    (b"", "application/msgpack", "surveilnav.RobotStatus/1.0"),
    (b"\xff" * 100, "application/msgpack", "surveilnav.RobotStatus/1.0"),
    (b"\x80", "application/msgpack", "surveilnav.RobotStatus/2.0"),
    (b"\x80", "application/msgpack", "surveilnav.Command/1.0"),
    (b"\x80", "text/plain", ""),
]


def test_hostile_puts_are_counted_and_dropped(make_node):
    node, stranger = make_node("b", "b"), make_node("x", "x", alive=False)
    table = node.table(ROBOT_STATUS)
    slot = node.slot(ROBOT_OBSERVATION, robot="r1")
    for payload, mime, schema in HOSTILE:
        encoding = zenoh.Encoding(mime).with_schema(schema)
        stranger.session.put(stranger.key(ROBOT_STATUS, robot="r1"), payload, encoding=encoding)
    stranger.session.put(stranger.key(ROBOT_OBSERVATION, robot="r1"), b"no header")
    assert eventually(lambda: node.traffic.rejected().get("robot_status") == len(HOSTILE))
    assert eventually(lambda: slot.poll() is None and node.traffic.rejected().get("robot_observation") == 1)
    assert table.rows() == []
    stranger.publisher(ROBOT_STATUS, robot="r1").put(status(9))
    assert eventually(lambda: table.get(robot="r1") and table.get(robot="r1").message.seq == 9)


def test_hostile_queries_are_refused_with_a_reason(make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    server.serve(MISSION_GOAL, lambda r: Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued")))
    time.sleep(0.2)
    with pytest.raises(Refused, match="expected schema") as refused:
        client.ask(MISSION_GOAL, Command(stamp_ns=1, action="stop", seq_expected=1), mission="m")
    assert refused.value.name == "bad_message"
    with pytest.raises(Refused, match="without a payload"):
        client.ask(MISSION_GOAL, mission="m")
    key = client.key(MISSION_GOAL, mission="m")
    encoding = zenoh.Encoding("application/msgpack").with_schema(schema_of(MissionGoal))
    replies = list(client.session.get(key, payload=b"\xc1\xc1", encoding=encoding, timeout=2.0))
    assert [r.ok for r in replies] == [None]
    assert server.traffic.rejected()["mission_goal"] == 3


def test_presence_follows_life(make_node, bus):
    watcher = make_node("b", "b")
    assert watcher.alive("robot") == set()
    with Node("robot", "r7", bus):
        assert eventually(lambda: watcher.alive("robot") == {"r7"})
    assert eventually(lambda: watcher.alive("robot") == set())


def test_bytes_offered_delivered_and_on_the_wire_agree(make_node):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher = sender.publisher(TRUTH, source="robot-r1", view=0)
    slot = receiver.slot(TRUTH, source="robot-r1", view=0)
    eventually(lambda: publisher.matched)
    before = sender.traffic_report().wire_sent_bytes
    for seq in range(10):
        publisher.put(truth(seq), bytes(500_000))
        assert eventually(slot.poll)
    offered = sum(r.n_bytes for r in sender.traffic.rows() if r.key == publisher.key and r.direction == "offered")
    delivered = sum(r.n_bytes for r in receiver.traffic.rows() if r.key == publisher.key and r.direction == "delivered")
    assert offered == delivered > 5_000_000
    sent = sender.traffic_report().wire_sent_bytes - before
    assert 1.0 <= sent / offered < 1.01


def test_a_loop_that_hangs_is_not_healthy(bus, tmp_path, monkeypatch):
    monkeypatch.setattr("surveilnav.bus.node._STALLED_S", 0.3)
    hang = threading.Event()
    settings = bus.model_copy(update={"health_file": tmp_path / "healthy"})
    with Node("a", "a", settings) as node:
        loop = threading.Thread(target=node.run, args=(lambda: hang.is_set() and time.sleep(3),))
        loop.start()
        assert eventually(settings.health_file.exists)
        assert node.healthy()
        hang.set()
        assert eventually(lambda: not node.healthy())
        node.stop()
        loop.join()


def test_no_router_and_a_taken_port_are_told_apart():
    port = free_port()
    with (
        pytest.raises(BusError, match=f"no router answers at tcp/127.0.0.1:{port}"),
        Node("a", "a", BusSettings(router=f"tcp/127.0.0.1:{port}", connect_timeout_s=0.5)),
    ):
        pass
    with open_router(f"tcp/127.0.0.1:{port}"), pytest.raises(BusError, match=f"port {port} .* is taken"):
        open_router(f"tcp/127.0.0.1:{port}")


def test_a_router_that_returns_is_found_again(tmp_path):
    port = free_port()
    settings = BusSettings(router=f"tcp/127.0.0.1:{port}", connect_timeout_s=5)
    router = open_router(f"tcp/127.0.0.1:{port}")
    with Node("a", "a", settings) as sender, Node("b", "b", settings) as receiver:
        table = receiver.table(ROBOT_STATUS)
        publisher = sender.publisher(ROBOT_STATUS, robot="r1")
        router.close()
        time.sleep(0.5)
        with open_router(f"tcp/127.0.0.1:{port}"):

            def arrives():
                publisher.put(status(5))
                return table.get(robot="r1")

            assert eventually(arrives, timeout_s=15)
