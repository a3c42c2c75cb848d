"""The id of a request travels in attachments, and is bound where a message is handled."""

from __future__ import annotations

import io
import threading

import msgspec
import pytest
import structlog
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.bus import Answer, bound_request_id, is_request_id, keep_request_id, logs, request_id
from surveilnav.bus.connection import encoding_of
from surveilnav.bus.correlation import attach_request_id, attached_request_id, has_no_message
from surveilnav.bus.wire import decode, encode
from surveilnav.contract import MISSION_GOAL, ROBOT_STATUS
from surveilnav.messages import MissionAck, MissionGoal, RobotStatus, Truth
from tests.bulk_stream import BULK
from tests.waiting import until, until_heard

GOAL = MissionGoal(stamp_ns=1, mission="m", target="tv")


@given(st.text(st.characters(codec="ascii"), max_size=80))
def test_an_id_comes_out_of_an_attachment_as_it_went_in(id):
    with bound_request_id(id):
        alone, beside = attach_request_id(), attach_request_id(encode(GOAL))
    expected = id if is_request_id(id) else ""
    assert (attached_request_id(alone), attached_request_id(beside)) == (expected, expected)
    assert decode(MissionGoal, beside, "surveilnav.MissionGoal/1.0") == GOAL, (
        "whoever doesn't know the field reads the message"
    )
    assert has_no_message(alone)
    assert not has_no_message(beside)


def test_without_a_request_nothing_is_added():
    assert (attach_request_id(), attach_request_id(b"header")) == (b"", b"header")
    assert attached_request_id(encode(GOAL)) == ""
    assert not has_no_message(encode(GOAL))


@given(st.binary(max_size=60))
def test_hostile_attachments_have_no_id(noise):
    for attachment in (noise, b"\x81\xaarequest_id" + noise, msgspec.msgpack.encode({"request_id": noise})):
        assert is_request_id(attached_request_id(attachment) or "none")
        has_no_message(attachment)
    for id in ("a" * 65, "a b", "a\n", "", 7, ["a"]):
        assert attached_request_id(msgspec.msgpack.encode({"request_id": id})) == ""


def test_a_thread_keeps_the_request_of_who_began_it():
    seen = []
    with bound_request_id("r-1"):
        threads = [threading.Thread(target=keep_request_id(lambda: seen.append(request_id()))) for _ in range(2)]
    for thread in [*threads, threading.Thread(target=lambda: seen.append(request_id()))]:
        thread.start()
        thread.join()
    assert seen == ["r-1", "r-1", ""]


def test_queries_and_answers_work_on_the_request_of_who_asked(make_node):
    planner, client, seen = make_node("planner", "p"), make_node("cli", "c"), []

    def on_goal(request):
        seen.append(request_id())
        return Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued"))

    planner.serve(MISSION_GOAL, on_goal)
    until_heard(lambda: client.ask(MISSION_GOAL, GOAL, mission="m"))
    with bound_request_id("r-1"):
        client.ask(MISSION_GOAL, GOAL, mission="m")
    client.ask(MISSION_GOAL, GOAL, mission="m")
    assert seen[-3:] == ["", "r-1", ""]


def test_a_query_to_everybody_still_asks_nobody_who_needs_a_message(make_node, status):
    """The id alone isn't a message: a query for statuses of robots, with an id, is no bad query for anybody else."""
    robot, client, seen = make_node("robot", "r1"), make_node("cli", "c"), []

    def answer(_):
        seen.append(request_id())
        return Answer(status(3))

    robot.serve(ROBOT_STATUS, answer, robot="r1")
    until_heard(lambda: client.ask(ROBOT_STATUS, robot="r1"))
    with bound_request_id("r-1"):
        assert [row.message.seq for row in client.ask_all(ROBOT_STATUS)] == [3]
    assert seen[-1] == "r-1"
    assert not robot.traffic.rejected()


@pytest.mark.parametrize("stream", [ROBOT_STATUS, BULK], ids=["message alone", "message beside a payload"])
def test_what_is_published_belongs_to_the_request(make_node, status, truth, stream):
    robot, reader, heard, latest = make_node("robot", "r1"), make_node("cli", "c"), [], []
    ids = {"robot": "r1"} if stream is ROBOT_STATUS else {"source": "robot-r1", "view": 0}
    reader.subscribe(stream, lambda received: heard.append((request_id(), received.request_id, received.message.seq)))
    newest = reader.latest(stream, **ids)
    publisher = robot.publisher(stream, **ids)
    until(lambda: publisher.matched)

    def put(seq):
        publisher.put(status(seq)) if stream is ROBOT_STATUS else publisher.put(truth(seq), b"payload")

    put(1)
    with bound_request_id("r-1"):
        put(2)
    until(lambda: len(heard) == 2)
    assert heard == [("", "", 1), ("r-1", "r-1", 2)]
    until(lambda: latest.append(newest.poll()) or (latest[-1] and latest[-1].message.seq == 2))
    assert latest[-1].request_id == "r-1"
    assert latest[-1].payload == (b"payload" if stream is BULK else b"")


def test_a_strangers_id_that_is_none_is_passed_over(make_node, status, truth, stranger):
    reader, heard = make_node("cli", "c"), []
    for stream in (ROBOT_STATUS, BULK):
        reader.subscribe(stream, heard.append)
    statuses, truths = reader.key(ROBOT_STATUS, robot="r1"), reader.key(BULK, source="robot-r1", view=0)

    def put():
        hostile = msgspec.msgpack.encode({"request_id": "x\n[error] forged"})
        stranger.put(statuses, encode(status(1)), attachment=hostile, encoding=encoding_of(RobotStatus))
        header = msgspec.msgpack.encode({**msgspec.msgpack.decode(encode(truth(1))), "request_id": "a" * 1000})
        stranger.put(truths, b"payload", attachment=header, encoding=encoding_of(Truth))
        return {type(h.message) for h in heard} == {RobotStatus, Truth}

    until(put)
    assert {h.request_id for h in heard} == {""}
    assert not reader.traffic.rejected()


def test_log_lines_say_to_which_request_they_belong(make_node, monkeypatch):
    monkeypatch.setattr("sys.stderr", stderr := io.StringIO())
    logs.configure("json")
    try:
        log, node = structlog.get_logger(), make_node("cli", "c")
        log.info("before")
        with bound_request_id("r-1"):
            log.info("within")
            for _ in range(2):
                node.log_once("once")
        node.log_once("never")
    finally:
        structlog.reset_defaults()
    lines = [msgspec.json.decode(line) for line in stderr.getvalue().splitlines()]
    said = [
        (line["event"], line.get("request_id"))
        for line in lines
        if line["event"] in ("before", "within", "once", "never")
    ]
    assert said == [("before", None), ("within", "r-1"), ("once", "r-1")]
