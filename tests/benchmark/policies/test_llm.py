"""The policy that asks a language model: its prompt, its answers, and a server that fails in every way."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from surveilnav.benchmark import journal
from surveilnav.benchmark.policies import POLICIES, Task, llm
from surveilnav.benchmark.policies.language_model import (
    ANSWERS_FILE,
    Cost,
    LanguageModel,
    LanguageModelSettings,
    Question,
    kept_questions,
)
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.goals.frontiers import Frontier


def completion(text, **usage):
    return json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}], "usage": usage, "id": "x"})


@pytest.fixture
def model(server, tmp_path):
    return LanguageModel("tiny", LanguageModelSettings(url=server.url, timeout_s=0.3), tmp_path)


def frontier(x_m, travel_time_m, y_m=0.0):
    return Frontier(x_m, y_m, 20, travel_time_m)


def thing(label, x_m, y_m=0.0, status="candidate"):
    return SimpleNamespace(label=label, center_m=(x_m, y_m, 0.5), status=status)


NEAR, MIDDLE, FAR = frontier(2.0, 2.0), frontier(-4.0, 5.2), frontier(0.0, 9.0, 9.0)
FOUND = [FAR, NEAR, MIDDLE]


def context_of(step=0, floor="0", objects=()):
    return SimpleNamespace(
        config=PlannerConfig(),
        maps=SimpleNamespace(objects=list(objects)),
        robot=SimpleNamespace(x_m=0.0, y_m=0.0, yaw_rad=0.0, floor=floor),
        state=SimpleNamespace(target="bed", step=step),
    )


def scores(*values):
    return completion(json.dumps({"scores": values}), prompt_tokens=70, completion_tokens=9)


def goals(rated):
    return [r.frontier for r in rated if r.utility > 0.0]


# --- the prompt ---------------------------------------------------------------------------------------------------


def test_the_prompt_lists_what_is_near_each_frontier_how_far_it_is_and_where():
    things = [
        thing("chair", 2.5),
        thing("chair", 3.0),
        thing("bed", 3.9),
        thing("sink", 2.0, status="rejected"),
        thing("tv", 4.1),
    ]
    text = llm.question("bed", [NEAR, MIDDLE, FAR], things, context_of().robot)
    assert text.splitlines() == [
        "The robot searches for: bed",
        "Places:",
        "1. 2 m, straight ahead; near it: bed, chair (2)",
        "2. 5 m, behind; near it: nothing known",
        "3. 9 m, to the left; near it: nothing known",
    ]


@pytest.mark.parametrize(
    ("x_m", "y_m", "yaw_rad", "where"),
    [
        (1.0, 0.1, 0.0, "straight ahead"),
        (1.0, 1.0, 0.0, "ahead to the left"),
        (0.0, -1.0, 0.0, "to the right"),
        (-1.0, -1.0, 0.0, "behind to the right"),
        (-1.0, -0.1, 0.0, "behind"),
        (1.0, 0.0, 1.57, "to the right"),
        (1.0, 0.0, -3.1, "behind"),
    ],
)
def test_directions_are_the_robots(x_m, y_m, yaw_rad, where):
    robot = SimpleNamespace(x_m=5.0, y_m=5.0, yaw_rad=yaw_rad)
    assert llm.direction(frontier(5.0 + x_m, 1.0, 5.0 + y_m), robot) == where


@pytest.mark.parametrize(
    ("answer", "read"),
    [
        ('{"scores": [0.1, 1, 0.5]}', [0.1, 1.0, 0.5]),
        ("```json\n[0, 0, 0.25]\n```", [0.0, 0.0, 0.25]),
        ("Places [1, 2] are rooms.\nAnswer: [0.1, 0.2, 0.3]", [0.1, 0.2, 0.3]),
        ("", None),
        ("the second one", None),
        ("[0.1, 0.2]", None),
        ("[0.1, 0.2, 0.3, 0.4]", None),
        ("[0.1, 0.2, 1.3]", None),
        ("[0.1, 0.2, -0.3]", None),
        ("[0.1, 0.2, NaN]", None),
        ('[0.1, 0.2, "high"]', None),
        ("[0.1, 0.2, true]", None),
        ("[0.1, 0.2, 1e999]", None),
        ("[0.1, 0.2", None),
    ],
)
def test_only_a_list_of_as_many_shares_is_an_answer(answer, read):
    assert llm.scores_in(answer, 3) == read


# --- the rule -----------------------------------------------------------------------------------------------------


def test_the_highest_score_is_gone_to_and_of_equals_the_nearest(server, model):
    server.body = scores(0.2, 0.7, 0.7)  # near, middle, far
    rated = llm.LlmRule(model)(context_of(), FOUND)
    assert goals(rated) == [MIDDLE]
    assert [r.frontier for r in rated] == FOUND
    (asked,) = server.asked
    assert asked["model"] == "tiny"
    assert [m["role"] for m in asked["messages"]] == ["system", "user"]
    assert server.paths == ["/v1/chat/completions"]
    assert "Authorization" not in server.headers[0]


def test_it_asks_again_after_25_steps_and_when_the_goal_is_explored(server, model):
    server.body = scores(0.2, 0.7, 0.1)
    rule = llm.LlmRule(model)
    moved = replace(MIDDLE, x_m=MIDDLE.x_m + 0.5, travel_time_m=4.0)
    assert goals(rule(context_of(0), FOUND)) == [MIDDLE]
    assert goals(rule(context_of(24), [NEAR, FAR, moved])) == [moved]
    assert len(server.asked) == 1
    assert goals(rule(context_of(25), [NEAR, FAR, moved])) == [moved]
    assert len(server.asked) == 2
    server.body = scores(0.2, 0.7)
    assert goals(rule(context_of(26), [NEAR, FAR])) == [FAR]
    assert len(server.asked) == 3
    assert goals(rule(context_of(27, floor="1"), [NEAR, FAR])) == [FAR]
    assert len(server.asked) == 3  # another floor, but the same question
    assert [q.outcome for q in kept_questions(model._path.parent)] == ["answered"] * 3 + ["cached"]


def test_it_isnt_asked_where_there_is_no_choice(server, model):
    rule = llm.LlmRule(model)
    assert rule(context_of(), []) == []
    assert goals(rule(context_of(), [FAR])) == [FAR]
    assert not server.asked


def test_of_many_frontiers_the_nearest_are_listed(server, model):
    many = [frontier(float(i), float(i)) for i in range(20, 0, -1)]
    server.body = scores(*[0.1] * 11, 0.9)
    assert goals(llm.LlmRule(model)(context_of(), many)) == [many[8]]
    assert "12. 12 m" in server.asked[0]["messages"][1]["content"]
    assert "13." not in server.asked[0]["messages"][1]["content"]


FAILING = {
    "slow": ("timed_out", {"wait_s": 5.0}),
    "for ever": ("timed_out", {"trickle_s": 0.05}),
    "a status of failure": ("refused", {"status": 500, "body": scores(0.1, 0.2, 0.3)}),
    "too many requests": ("refused", {"status": 429}),
    "broken JSON": ("malformed", {"body": '{"choices": [{"mess'}),
    "no text": ("malformed", {"body": "\ufffd"}),
    "no choice": ("malformed", {"body": '{"choices": []}'}),
    "no message": ("malformed", {"body": '{"choices": [{"message": {"content": null}}]}'}),
    "tokens that can't be": ("malformed", {"body": completion("[0.1, 0.2, 0.3]", prompt_tokens=-1)}),
    "too much": ("malformed", {"body": completion("x" * (2 << 20))}),
    "a wrong number of scores": ("unusable", {"body": scores(0.1, 0.2)}),
    "a score out of range": ("unusable", {"body": scores(0.1, 0.2, 7.0)}),
    "no scores": ("unusable", {"body": completion("I'd go left.")}),
}


@pytest.mark.parametrize("how", FAILING)
def test_without_an_answer_that_decision_is_ours_and_counted(how, server, model, tmp_path, monkeypatch):
    outcome, behaves = FAILING[how]
    for name, value in behaves.items():
        setattr(server, name, value)
    monkeypatch.setattr(llm, "rule_of", lambda config: lambda context, found: ("ours", found))
    rule = llm.LlmRule(model)
    assert rule(context_of(0), FOUND) == ("ours", FOUND)
    assert rule(context_of(24), FOUND) == ("ours", FOUND)  # a server that fails isn't asked at every step
    assert len(server.asked) == 1
    assert Cost.of(kept_questions(tmp_path)).failed == {outcome: 1}
    server.status, server.body, server.wait_s, server.trickle_s = 200, scores(0.1, 0.2, 0.9), 0.0, 0.0
    assert goals(rule(context_of(25), FOUND)) == [FAR]


def test_a_server_that_isnt_there_is_counted(server, tmp_path):
    settings = LanguageModelSettings(url=server.url.replace("/v1", "x/v1"), timeout_s=0.3)
    assert LanguageModel("tiny", settings, tmp_path).ask("a", "b", str) is None
    assert Cost.of(kept_questions(tmp_path)).failed == {"unreachable": 1}


# --- what is kept -------------------------------------------------------------------------------------------------


def test_an_answer_is_known_to_the_next_process_and_costs_once(server, model, tmp_path):
    server.body = completion("yes", prompt_tokens=70, completion_tokens=9)
    settings = LanguageModelSettings(url=server.url, key="secret")
    again = LanguageModel("tiny", settings, tmp_path)
    assert model.ask("a", "b", str) == "yes"
    assert model.ask("a", "b", str) == "yes"
    assert LanguageModel("tiny", settings, tmp_path).ask("a", "b", str) == "yes"
    assert len(server.asked) == 1
    assert LanguageModel("large", settings, tmp_path).ask("a", "b", str) == "yes"
    assert again.ask("a", "c", str) == "yes"
    assert len(server.asked) == 3
    assert server.headers[-1]["Authorization"] == "Bearer secret"
    assert "secret" not in (tmp_path / ANSWERS_FILE).read_text()
    cost = Cost.of(kept_questions(tmp_path))
    assert (cost.asked, cost.cached, cost.failed, cost.prompt_tokens, cost.completion_tokens) == (3, 2, {}, 210, 27)
    assert cost.seconds > 0.0


def test_a_cost_in_words():
    questions = [
        Question(key="a", outcome="answered", prompt_tokens=100, completion_tokens=10, seconds=1.5),
        Question(key="a", outcome="cached"),
        Question(key="b", outcome="timed_out", seconds=20.0),
        Question(key="b", outcome="unusable", prompt_tokens=50, completion_tokens=5, seconds=0.5),
    ]
    assert str(Cost.of(questions)) == (
        "3 questions asked, 1 known from the cache, 2 without an answer that could be used (1 timed_out, 1 unusable); "
        "150 prompt and 15 completion tokens; 22.0 s waited, 7.33 s a question"
    )
    assert str(Cost.of([])).startswith("0 questions asked, 0 known from the cache, 0 without")


def test_what_is_kept_and_cant_be_read_is_named(server, tmp_path):
    journal.append(tmp_path / ANSWERS_FILE, '{"key": 7}')
    with pytest.raises(ConfigError, match=r"answers\.jsonl can't be read.*move it away"):
        LanguageModel("tiny", LanguageModelSettings(url=server.url), tmp_path)


# --- settings -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("environment", "settings", "said"),
    [
        ({}, {"policy": "llm"}, "say which by --language-model"),
        ({}, {"policy": "llm", "language_model": "tiny"}, "set SURVEILNAV_LLM__URL"),
        ({"URL": "localhost:8000"}, {"policy": "llm", "language_model": "tiny"}, "it is 'localhost:8000'"),
        ({"URL": "http://a", "TIMEOUT_S": "soon"}, {"policy": "llm", "language_model": "tiny"}, "can't be"),
        ({"URL": "http://a", "KEY": "a\nb"}, {"policy": "llm", "language_model": "tiny"}, "KEY has characters"),
        ({"URL": "http://a"}, {"language_model": "tiny"}, "'surveilnav' asks no language model"),
    ],
)
def test_a_missing_or_wrong_setting_is_said_before_anything_is_played(environment, settings, said, monkeypatch):
    for name in ("URL", "KEY", "TIMEOUT_S"):
        monkeypatch.delenv(f"SURVEILNAV_LLM__{name}", raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(f"SURVEILNAV_LLM__{name}", value)
    with pytest.raises(ConfigError, match=said):
        RunSettings(**settings).check()


def test_with_a_server_and_a_model_it_may_be_played(monkeypatch):
    monkeypatch.setenv("SURVEILNAV_LLM__URL", "http://127.0.0.1:1/v1")
    RunSettings(policy="llm", language_model="tiny").check()


def test_it_is_begun_only_with_a_model():
    with pytest.raises(ValueError, match=r"needs Task\.language_model"):
        POLICIES["llm"].begin(Task("bed", 0, 10, None))
