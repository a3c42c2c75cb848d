"""A language model says which frontier is most promising. Off unless a server is named (``LanguageModelSettings``).

One prompt lists the frontiers: the objects within 2 m of each, how far it is, and in which direction. The model answers with a
score for each, and the robot goes to the highest. So L3MVN (https://arxiv.org/abs/2304.05501) asks about what is near a frontier,
OpenFMNav (https://arxiv.org/abs/2402.10670, https://github.com/yxKryptonite/OpenFMNav) for a score of each area in one prompt,
and InstructNav (https://arxiv.org/abs/2406.04882) by a list of all that was seen. It is asked again when that frontier is
explored, and after 25 steps, as L3MVN does. If no answer comes in time, or none that can be used, frontiers are rated as ours
until it is asked again.
Not kept of these: pictures (no option is shown as one), words that the model thinks of itself, and plans of several steps.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence

import msgspec

from surveilnav.benchmark.policies.language_model import LanguageModel
from surveilnav.benchmark.policies.mission import MissionPolicy
from surveilnav.benchmark.policies.policy import Policy, Task
from surveilnav.messages import ObjectRecord
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig, RobotView
from surveilnav.services.planner.core.context import RatedFrontier, StepContext
from surveilnav.services.planner.core.goals.frontier_access import frontier_at
from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.options.frontiers import only, rule_of

SYSTEM = """\
You help a robot that searches a building for an object that it hasn't seen yet. It tells you the places from which unexplored
space can be entered: which objects it recognised near each, how far the way there is, and in which direction it lies. Think of
what kind of room each place may lead to, and where such an object usually is. A long way costs time, so of two places that are
as likely the nearer one is better. A place with no known object near it isn't unlikely.
Answer with one JSON object and nothing else: {"scores": [...]}, with one number from 0 to 1 for each place, in the order of the
list. The higher it is, the better it is to go there next."""

_EVERY_STEPS = 25
_WITHIN_M = 2.0
#: So many of the nearest are listed.
_MOST = 12
_DIRECTIONS = (
    "straight ahead",
    "ahead to the left",
    "to the left",
    "behind to the left",
    "behind",
    "behind to the right",
    "to the right",
    "ahead to the right",
)


class LlmRule:
    """Chooses the frontier of the highest score; remembers which, and when it last asked."""

    def __init__(self, model: LanguageModel) -> None:
        self._model = model
        self._goal: tuple[str, float, float] | None = None
        self._asked_at = -_EVERY_STEPS

    def __call__(self, context: StepContext, found: Sequence[Frontier]) -> list[RatedFrontier]:
        """See ``FrontierRule``."""
        if len(found) < 2:
            return [rated for f in found for rated in only(context, f, found, "the only one")]
        listed = sorted(found, key=lambda f: f.travel_time_m)[:_MOST]
        goal, had_goal = self._goal_among(found, context), self._goal is not None
        if context.state.step - self._asked_at >= _EVERY_STEPS or (had_goal and goal is None):
            self._asked_at, goal = context.state.step, self._ask(context, listed)
        if goal is None:
            self._goal = None
            return rule_of(context.config)(context, found)
        self._goal = context.robot.floor, goal.x_m, goal.y_m
        return only(context, goal, found, "by the language model")

    def _goal_among(self, found: Sequence[Frontier], context: StepContext) -> Frontier | None:
        """The frontier that was last chosen, also where it moved a little; None: it isn't there any more."""
        if self._goal is None or self._goal[0] != context.robot.floor:
            return None
        return frontier_at(self._goal[1:], found, 1.5 * context.config.same_place_m)

    def _ask(self, context: StepContext, listed: Sequence[Frontier]) -> Frontier | None:
        """The frontier of the highest score, of equals the nearest; None: there is no answer that can be used."""
        text = question(context.state.target, listed, context.maps.objects, context.robot)
        scores = self._model.ask(SYSTEM, text, lambda answer: scores_in(answer, len(listed)))
        if scores is None:
            return None
        best = max(range(len(listed)), key=lambda i: (scores[i], -i))
        return listed[best]


def question(target: str, frontiers: Sequence[Frontier], objects: Iterable[ObjectRecord], robot: RobotView) -> str:
    """The user's message. Ways are rounded to metres, so that the same question comes again more often."""
    things = [o for o in objects if o.status != "rejected"]
    lines = []
    for n, f in enumerate(frontiers, 1):
        near = Counter(o.label for o in things if math.dist(o.center_m[:2], (f.x_m, f.y_m)) <= _WITHIN_M)
        named = ", ".join(f"{label} ({many})" if many > 1 else label for label, many in sorted(near.items()))
        lines.append(
            f"{n}. {max(1, round(f.travel_time_m))} m, {direction(f, robot)}; near it: {named or 'nothing known'}"
        )
    return f"The robot searches for: {target}\nPlaces:\n" + "\n".join(lines)


def direction(frontier: Frontier, robot: RobotView) -> str:
    """Where a frontier lies as the robot looks now, in eighths of a turn."""
    bearing_rad = math.atan2(frontier.y_m - robot.y_m, frontier.x_m - robot.x_m) - robot.yaw_rad
    return _DIRECTIONS[round(bearing_rad / (math.pi / 4)) % 8]


def scores_in(answer: str, n: int) -> list[float] | None:
    """The last list in an answer; None: there is none, or not one of ``n`` numbers from 0 to 1."""
    lists = re.findall(r"\[[^\[\]]*\]", answer)
    try:
        scores = msgspec.json.decode(lists[-1], type=list[float]) if lists else []
    except msgspec.DecodeError:
        return None
    return scores if len(scores) == n and all(0.0 <= s <= 1.0 for s in scores) else None


def _begin(task: Task) -> MissionPolicy:
    if task.language_model is None:
        raise ValueError("llm needs Task.language_model: begin it only where Policy.needs_language_model is honoured")
    return MissionPolicy(task, PlannerConfig(), LlmRule(task.language_model))


LLM = Policy(
    "llm",
    "the frontier that a language model scores highest (SURVEILNAV_LLM__URL), asked as OpenFMNav does "
    "(https://arxiv.org/abs/2402.10670), with our verification",
    _begin,
    FusionConfig(),
    needs_language_model=True,
)
