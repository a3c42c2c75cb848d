"""Queries on a real router: answered, refused by name, unanswered; bounded queues."""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
import zenoh

from surveilnav.bus import Answer, Refused, Unanswered
from surveilnav.bus.connection import encoding_of
from surveilnav.bus.wire import encode
from surveilnav.contract import (
    CAMERA_INFO,
    CAMERA_REQUEST,
    JUDGED,
    MAP_LAYER,
    MISSION_CANCEL,
    MISSION_GOAL,
    ROBOT_HALT,
    ROBOT_STATUS,
    schema_of,
)
from surveilnav.geometry import Grid, Pinhole
from surveilnav.messages import CameraInfo, Command, Halt, HaltReply, LayerHeader, MissionAck, MissionGoal
from tests.waiting import until, until_heard


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
    assert until_heard(lambda: ask("tv")).message.accepted
    with pytest.raises(Refused, match="no unicorns") as refused:
        ask("unicorn")
    assert refused.value.name == "bad_target"
    with pytest.raises(Refused, match="ZeroDivisionError") as refused:
        ask("bug")
    assert refused.value.name == "internal"
    assert ask("tv").message.accepted  # a handler's bug ends nothing
    with pytest.raises(Unanswered, match="nobody is there") as unanswered:
        client.ask(MISSION_CANCEL, MissionGoal(stamp_ns=1, mission="m", target="tv"), mission="m")
    assert not unanswered.value.timed_out


def test_a_handler_may_answer_later_and_holds_no_thread_meanwhile(make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    waiting: list[Future] = []

    def later(request):
        waiting.append(Future())
        return waiting[-1]

    server.serve(MISSION_GOAL, later)
    goal = MissionGoal(stamp_ns=1, mission="m", target="tv")
    with ThreadPoolExecutor(3) as pool:
        answers = [pool.submit(until_heard, lambda: client.ask(MISSION_GOAL, goal, mission="m")) for _ in range(3)]
        until(lambda: len(waiting) == 3, "one thread took all three in")
        waiting[0].set_result(Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued")))
        waiting[1].set_exception(Refused("busy", "later", retry_after_ms=70))
        waiting[2].set_exception(ZeroDivisionError("oops"))
        told = []
        for answer in answers:
            try:
                told.append(answer.result().message.accepted)
            except Refused as error:
                told.append((error.name, error.retry_after_ms))
    assert sorted(told, key=str) == [("busy", 70), ("internal", None), True]


@pytest.mark.parametrize(("hint", "told"), [(None, None), (70, 70), (lambda: 80, 80)])
def test_a_full_queue_refuses_at_once_and_says_when_to_come_again(hint, told, make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    release = threading.Event()

    def slow(request):
        release.wait(10)
        return Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued"))

    server.serve(MISSION_GOAL, slow, capacity=1, retry_after_ms=hint)
    goal = MissionGoal(stamp_ns=1, mission="m", target="tv")
    answers, hints = [], []

    def ask():
        try:
            answers.append(client.ask(MISSION_GOAL, goal, mission="m", timeout_s=10).message.accepted)
        except Refused as error:
            answers.append(error.name)
            hints.append(error.retry_after_ms)

    time.sleep(0.2)
    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
        time.sleep(0.1)
    until(lambda: answers.count("busy") == 2)
    release.set()
    for thread in threads:
        thread.join()
    assert sorted(map(str, answers)) == ["True", "True", "busy", "busy"]
    assert hints == [told] * 2


def test_parameters_survive_spaces_and_semicolons(make_node, status):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    seen = []

    def answer(request):
        seen.append(request.parameters)
        return Answer(status())

    server.serve(ROBOT_STATUS, answer, robot="r1")
    parameters = {"target": "potted plant; x=1 & ä", "n": "2"}
    until_heard(lambda: client.ask(ROBOT_STATUS, robot="r1", parameters=parameters))
    assert seen[0] == parameters


def test_hostile_queries_are_refused_with_a_reason(make_node, stranger):
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
    replies = list(stranger.get(key, payload=b"\xc1\xc1", encoding=encoding, timeout=2.0))
    assert [r.ok for r in replies] == [None]
    assert server.traffic.rejected()["mission_goal"] == 3


def test_who_is_there_but_too_slow_is_told_from_nobody(make_node):
    server, client = make_node("planner", "p"), make_node("cli", "c")
    release = threading.Event()

    def slow(request):
        release.wait(10)
        return Answer(MissionAck(stamp_ns=1, mission="m", accepted=True, state="queued"))

    server.serve(MISSION_GOAL, slow)
    time.sleep(0.2)
    with pytest.raises(Unanswered, match="not within") as unanswered:
        client.ask(MISSION_GOAL, MissionGoal(stamp_ns=1, mission="m", target="tv"), mission="m", timeout_s=0.3)
    release.set()
    assert unanswered.value.timed_out


def test_a_question_to_all_reaches_each_owner_of_a_key(make_node):
    client = make_node("cli", "c")
    for robot in ("r2", "r5"):
        make_node("robot", robot).serve(
            ROBOT_HALT, lambda r: Answer(HaltReply(stamp_ns=1, robot=r.ids["robot"], halted=True)), robot=robot
        )
    halt = Halt(stamp_ns=1, halted=True)

    def owners():
        return {(a.ids["robot"], a.message.robot) for a in client.ask_all(ROBOT_HALT, halt, timeout_s=0.5)}

    until(lambda: owners() == {("r2", "r2"), ("r5", "r5")})


def test_a_question_to_another_stream_is_passed_over(make_node):
    """Who serves all keys of a stream also gets "truth/*/judged/*": "truth/camera/judged/info" fits "*/camera/*/info"."""
    client, server = make_node("cli", "c"), make_node("replay", "r")
    asked = []

    def tell(request):
        asked.append(request)
        info = CameraInfo(
            stamp_ns=1,
            camera="c0",
            floor="0",
            intrinsics=Pinhole.from_hfov(8, 8, 1.0),
            position_m=(0.0, 0.0, 1.0),
            views=[],
            mounting_offset_m=1.0,
        )
        return [Answer(info, ids={"floor": "0", "camera": "c0"})]

    server.serve(CAMERA_INFO, tell)
    server.serve(CAMERA_REQUEST, tell)
    until(lambda: client.ask_all(CAMERA_INFO, timeout_s=0.5))
    before = len(asked)
    assert client.ask_all(JUDGED, timeout_s=0.5) == []
    assert len(asked) == before + 1, "the question reached the one, not the other"
    assert not server.traffic.rejected()
    assert client.ask_all(CAMERA_INFO, timeout_s=0.5), "it answers still"


MAP = {"floor": "0", "layer": "cloud"}


@pytest.fixture
def answered(make_node, stranger):
    """``client, asked = answered(stream, *answers)``: a stranger answers each query with the next of ``answers`` (None: with
    nothing), then with nothing; ``asked`` grows by one a query."""
    kept = []

    def declare(stream, *answers):
        client, asked = make_node("planner", "p"), []

        def on_query(query):
            asked.append(1)
            if len(asked) <= len(answers) and (header := answers[len(asked) - 1]):
                query.reply(query.key_expr, b"map", attachment=header, encoding=encoding_of(stream.message))
            query.drop()

        key = client.key(stream)
        kept.append(stranger.declare_queryable(key, on_query))
        querier = client._connection.session_for(stream).declare_querier(key)
        until(lambda: querier.matching_status.matching, "the router never heard of who answers")
        return client, asked

    yield declare
    for queryable in kept:
        queryable.undeclare()


def layer():
    grid = Grid(0.0, 0.0, 0.05, 1, 1)
    return LayerHeader(stamp_ns=1, floor="0", layer="cloud", revision=7, grid=grid, dtype="float32", shape=(0, 6))


def test_an_answer_that_was_left_out_is_asked_for_again(answered):
    """It looks as if nobody had answered."""
    client, asked = answered(MAP_LAYER, None, None, encode(layer()))
    got = client.ask(MAP_LAYER, **MAP, timeout_s=10.0)
    assert (got.message.revision, got.payload, len(asked)) == (7, b"map", 3)


def test_who_never_answers_is_not_asked_for_ever(answered):
    client, asked = answered(MAP_LAYER)
    with pytest.raises(Unanswered, match="a link on its way is full") as unanswered:
        client.ask(MAP_LAYER, **MAP, timeout_s=0.5)
    assert unanswered.value.timed_out
    assert len(asked) > 1


def test_an_answer_that_cant_be_read_is_not_asked_for_again(answered):
    client, asked = answered(MAP_LAYER, b"nonsense", encode(layer()))
    with pytest.raises(Unanswered, match="can't be read"):
        client.ask(MAP_LAYER, **MAP, timeout_s=5.0)
    assert len(asked) == 1


def test_what_is_never_left_out_is_asked_for_once(answered):
    client, asked = answered(ROBOT_STATUS)
    with pytest.raises(Unanswered, match="nobody is there"):
        client.ask(ROBOT_STATUS, robot="r1", timeout_s=5.0)
    assert len(asked) == 1


def test_nobody_is_there_for_maps_either(make_node):
    with pytest.raises(Unanswered, match="nobody is there") as unanswered:
        make_node("planner", "p").ask(MAP_LAYER, **MAP, timeout_s=1e3)
    assert not unanswered.value.timed_out


def test_answers_that_may_be_left_out_are_asked_for_one_at_a_time(make_node):
    """On a slow link two of them would leave out each other."""
    fusion, client = make_node("fusion", "f"), make_node("gateway", "g")
    entered, leave = threading.Semaphore(0), threading.Semaphore(0)

    def slowly(_):
        entered.release()
        leave.acquire()
        return Answer(layer(), b"map")

    fusion.serve(MAP_LAYER, slowly, workers=2)
    with ThreadPoolExecutor(2) as pool:
        ask = lambda: until_heard(lambda: client.ask(MAP_LAYER, **MAP, timeout_s=20.0))  # noqa: E731
        answers = [pool.submit(ask) for _ in range(2)]
        assert entered.acquire(timeout=10.0)
        assert not entered.acquire(timeout=0.3), "both were asked for at once"
        with pytest.raises(Unanswered, match=r"waited 0\.1 s for others") as unanswered:
            client.ask(MAP_LAYER, **MAP, timeout_s=0.1)
        assert unanswered.value.timed_out
        leave.release(2)
        assert [answer.result().payload for answer in answers] == [b"map"] * 2
