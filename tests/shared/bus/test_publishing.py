"""Puts on a real router: newest wins, hostile bytes dropped, bytes counted."""

from __future__ import annotations

import time

import pytest
import zenoh

from surveilnav.bus import Answer, Node
from surveilnav.contract import ROBOT_OBSERVATION, ROBOT_STATUS, TRAFFIC
from surveilnav.errors import BusError
from tests.bulk_stream import BULK
from tests.waiting import until, until_heard


def test_a_slot_keeps_only_the_newest(make_node, truth):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher = sender.publisher(BULK, source="robot-r1", view=0)
    assert not publisher.matched
    slot = receiver.latest(BULK, source="robot-r1", view=0)
    until(lambda: publisher.matched)
    offered = sum(publisher.put(truth(seq), b"x" * 100_000) for seq in range(20))
    time.sleep(0.3)
    received = slot.poll()
    assert received.message.seq == 19
    assert len(received.payload) == 100_000
    assert received.ids["source"] == "robot-r1"
    assert slot.poll() is None
    counted = {row.direction: row.n_bytes for row in receiver.traffic.rows() if row.key == publisher.key}
    assert set(counted) == {"delivered", "replaced"}
    assert counted["delivered"] < 200_000
    assert sum(counted.values()) == offered
    slot.close()
    until(lambda: not publisher.matched)


def test_traffic_reports_are_differences_that_a_table_puts_together(make_node, status):
    sender, reader = make_node("robot", "r1"), make_node("b", "b", alive=False)
    heard = []
    table = reader.table(TRAFFIC, on_message=lambda row: heard.append(row.message))
    quiet, busy = sender.publisher(ROBOT_STATUS, robot="r1"), sender.publisher(ROBOT_STATUS, robot="r2")
    quiet.put(status(1))
    until(lambda: heard)
    for n in range(400):
        busy.put(status(n))
    until(lambda: len(heard) > 1)
    assert [report.is_partial for report in heard] == [False, True]
    assert quiet.key not in {row.key for row in heard[1].rows}
    known = table.get(node="robot-r1").message
    assert not known.is_partial
    counted = {row.key: row.messages for row in known.rows if row.direction == "offered"}
    assert (counted[quiet.key], counted[busy.key]) == (1, 400)


def test_a_table_holds_what_was_put_before_and_after(make_node, status):
    owner, reader = make_node("robot", "r1"), make_node("b", "b")
    owner.serve(ROBOT_STATUS, lambda _: Answer(status(3)), robot="r1")
    until_heard(lambda: reader.ask(ROBOT_STATUS, robot="r1"))
    table = reader.table(ROBOT_STATUS)
    assert table.get(robot="r1").message.seq == 3
    publisher = owner.publisher(ROBOT_STATUS, robot="r1")
    publisher.put(status(4))
    until(lambda: table.get(robot="r1").message.seq == 4)
    assert table.get(robot="r2") is None
    assert table.rows(max_age_s=0) == []


HOSTILE = [
    (b"", "application/msgpack", "surveilnav.RobotStatus/1.0"),
    (b"\xff" * 100, "application/msgpack", "surveilnav.RobotStatus/1.0"),
    (b"\x80", "application/msgpack", "surveilnav.RobotStatus/2.0"),
    (b"\x80", "application/msgpack", "surveilnav.Command/1.0"),
    (b"\x80", "text/plain", ""),
]


def test_hostile_puts_are_counted_and_dropped(make_node, status, stranger):
    node, sender = make_node("b", "b"), make_node("x", "x", alive=False)
    table = node.table(ROBOT_STATUS)
    slot = node.latest(ROBOT_OBSERVATION, robot="r1")
    for payload, mime, schema in HOSTILE:
        encoding = zenoh.Encoding(mime).with_schema(schema)
        stranger.put(node.key(ROBOT_STATUS, robot="r1"), payload, encoding=encoding)
    until(lambda: node.traffic.rejected().get("robot_status") == len(HOSTILE))

    def refused():  # what is put before the router has heard of the slot is lost
        stranger.put(node.key(ROBOT_OBSERVATION, robot="r1"), b"no header")
        return slot.poll() is None and node.traffic.rejected().get("robot_observation")

    until(refused)
    assert table.rows() == []
    sender.publisher(ROBOT_STATUS, robot="r1").put(status(9))
    until(lambda: table.get(robot="r1") and table.get(robot="r1").message.seq == 9)


def test_bytes_offered_delivered_and_on_the_wire_agree(make_node, truth):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher = sender.publisher(BULK, source="robot-r1", view=0)
    slot = receiver.latest(BULK, source="robot-r1", view=0)
    until(lambda: publisher.matched)
    before = sender.traffic_report().wire_sent_bytes
    for seq in range(10):
        publisher.put(truth(seq), bytes(500_000))
        until(slot.poll)
    offered = sum(r.n_bytes for r in sender.traffic.rows() if r.key == publisher.key and r.direction == "offered")
    delivered = sum(r.n_bytes for r in receiver.traffic.rows() if r.key == publisher.key and r.direction == "delivered")
    assert offered == delivered > 5_000_000
    sent = sender.traffic_report().wire_sent_bytes - before
    assert 1.0 <= sent / offered < 1.01


def test_a_subscription_misses_nothing_and_ends(make_node, truth):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher = sender.publisher(BULK, source="robot-r1", view=0)
    seen = []
    subscription = receiver.subscribe(BULK, lambda received: seen.append(received))
    until(lambda: publisher.matched)
    for seq in range(20):
        publisher.put(truth(seq), b"x" * seq)
    until(lambda: len(seen) == 20)
    assert [(r.message.seq, len(r.payload)) for r in seen] == [(seq, seq) for seq in range(20)]
    subscription.close()
    until(lambda: not publisher.matched)


def test_what_cannot_be_sent_any_more_is_our_own_error(bus, truth):
    with Node("a", "a", bus) as node:
        publisher = node.publisher(BULK, source="robot-r1", view=0)
    with pytest.raises(BusError, match="truth/robot-r1/0"):
        publisher.put(truth(1), b"x")
