"""When what ended is started again, told by a table; and a supervisor over processes that are made here."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from surveilnav.cli import supervisor as module
from surveilnav.cli.stack import Stack
from surveilnav.cli.supervisor import RestartPolicy, Supervisor, how_it_ended
from surveilnav.contract import SERVICES
from surveilnav.errors import SurveilNavError
from tests.waiting import until


@pytest.mark.parametrize(
    ("lives_s", "wait_s"),
    [
        ([1.0], 0.5),
        ([1.0] * 2, 1.0),
        ([1.0] * 6, 16.0),
        ([1.0] * 8, 30.0),  # the longest
        ([1.0] * 9, None),
        ([100.0] * 9, None),  # slowly, but again and again
        ([1.0] * 7 + [121.0], 0.5),  # it had settled
        ([1.0] * 7 + [500.0, 1.0], 0.5),
        ([1.0] * 7 + [500.0, 1.0, 1.0], 1.0),
    ],
)
def test_the_wait_doubles_and_ends_by_giving_up(lives_s, wait_s):
    assert RestartPolicy().wait_s(lives_s) == wait_s


@pytest.mark.parametrize(
    ("code", "said"), [(0, "exit code 0"), (1, "exit code 1"), (-9, "SIGKILL"), (-250, "signal 250")]
)
def test_how_it_ended(code, said):
    assert how_it_ended(code) == said


class FakeStack(Stack):
    """Services that end when the test says so; ``started`` are those that were started again."""

    def __init__(self, log_dir: Path) -> None:
        super().__init__({}, log_dir)
        self.codes: dict[str, int | None] = {"router": None, "fusion": None, "camera-c0": None}
        self.started: list[str] = []
        self.processes = {name: SimpleNamespace(poll=lambda name=name: self.codes[name]) for name in self.codes}  # type: ignore[misc]

    def start(self, name: str) -> None:
        self.started.append(name)
        self.codes[name] = None


@pytest.fixture
def supervised(tmp_path, make_node, monkeypatch):
    """A fake stack, its supervisor, what was said, and a clock that the test turns."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now.s))
    stack, said = FakeStack(tmp_path), []
    (tmp_path / "fusion.log").write_text("first\nthe last words\n")
    return stack, Supervisor(stack, make_node("cli", "up", alive=False), said.append), said, now


def test_what_ends_is_started_again_after_a_wait_and_both_are_said(supervised):
    stack, supervisor, said, now = supervised
    supervisor.tend()
    stack.codes["fusion"] = -9
    for now.s, started in ((100.1, []), (100.5, []), (100.7, ["fusion"]), (101.0, ["fusion"])):
        supervisor.tend()
        assert stack.started == started
    stack.codes["fusion"] = 1
    for now.s, started in ((110.0, ["fusion"]), (110.9, ["fusion"]), (111.1, ["fusion", "fusion"])):
        supervisor.tend()
        assert stack.started == started
    assert [line.partition(";")[0] for line in said] == [
        "fusion ended (SIGKILL): it starts again in 0.5 s",
        "fusion started again (restart 1)",
        "fusion ended (exit code 1): it starts again in 1 s",
        "fusion started again (restart 2)",
    ]
    assert str(stack.log_of("fusion")) in said[0]


def test_the_others_are_watched_while_one_waits(supervised):
    stack, supervisor, _, now = supervised
    stack.codes["fusion"], stack.codes["router"] = 1, -11
    supervisor.tend()
    now.s += 0.6
    supervisor.tend()
    assert sorted(stack.started) == ["fusion", "router"]


def test_what_ends_again_and_again_ends_it_all_with_the_end_of_its_log(supervised):
    stack, supervisor, _, now = supervised
    with pytest.raises(SurveilNavError, match=r"fusion ended 9 times in a row, last by exit code 3") as gave_up:  # noqa: PT012
        for _ in range(2000):
            stack.codes["fusion"] = 3
            supervisor.tend()
            now.s += 0.1
    assert "the last words" in str(gave_up.value)
    assert stack.started == ["fusion"] * 8


def test_a_camera_that_ends_again_and_again_is_given_up_and_the_rest_goes_on(supervised):
    stack, supervisor, said, now = supervised
    (stack.log_dir / "camera-c0.log").write_text("no lens\n")
    for _ in range(2000):
        stack.codes["camera-c0"] = 3
        supervisor.tend()
        now.s += 0.1
    assert stack.started == ["camera-c0"] * 8
    assert sum("given up; the rest goes on without it" in line and "no lens" in line for line in said) == 1
    state = next(s for s in supervisor._services().services if s.name == "camera-c0")
    assert (state.running, state.given_up, state.restarts, state.why) == (False, True, 8, "exit code 3")


def test_everybody_may_know(supervised, make_node):
    stack, supervisor, _, now = supervised
    told = make_node("test", "t").table(SERVICES)

    def heard() -> dict:
        now.s += 0.2
        supervisor.tend()
        return {s.name: s for row in told.rows() for s in row.message.services}

    assert until(heard)["fusion"].restarts == 0
    stack.codes["fusion"] = -9
    waiting = until(lambda: (state := heard()["fusion"]) and not state.running and state)
    assert (waiting.restarts, waiting.why) == (0, "SIGKILL")
    back = until(lambda: (state := heard()["fusion"]) and state.running and state)
    assert (back.restarts, back.why, back.restarted_ns > 0) == (1, "SIGKILL", True)
    assert heard()["router"].restarts == 0
