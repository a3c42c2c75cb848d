"""What speaks for and against an object: detections by class and source, and looks that should have shown it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from surveilnav.services.fusion.core.objects.view_evidence import Direction, Looks


@dataclass(slots=True)
class Support:
    """What one kind of source (robots, or surveillance) says for one class of one object; ``score``: the sum of all scores."""

    n: int = 0
    score: float = 0.0

    def add(self, score: float, n: int = 1) -> None:
        """``n`` detections, of which the scores add up to ``score``."""
        self.n += n
        self.score += score


#: Of a class that nobody detected.
NOTHING = Support()


@dataclass(slots=True)
class Evidence:
    """All that was said about one object.

    Attributes:
        robot, surveillance: detections by class.
        looks: what each direction showed.
        misses: close robot views that should have shown its class and didn't.
        settled: the class that it was settled to be; empty before.
        flipped: the last change of that: from, to.
    """

    robot: dict[str, Support] = field(default_factory=dict)
    surveillance: dict[str, Support] = field(default_factory=dict)
    looks: Looks = field(default_factory=Looks)
    misses: int = 0
    settled: str = ""
    flipped: tuple[str, str] | None = None

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``from_state``."""
        kinds = {"robot": self.robot, "surveillance": self.surveillance}
        supports = {kind: {label: [s.n, s.score] for label, s in of_kind.items()} for kind, of_kind in kinds.items()}
        rest = {"looks": self.looks.state(), "misses": self.misses, "settled": self.settled, "flipped": self.flipped}
        return {**supports, **rest}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Evidence:
        """The evidence that ``state`` describes."""
        if "looks" not in state:
            state = _of_older(state)
        robot, surveillance = (
            {label: Support(*fields) for label, fields in state[kind].items()} for kind in ("robot", "surveillance")
        )
        flipped = None
        if state["flipped"] is not None:
            old, new = state["flipped"]
            flipped = old, new
        return cls(robot, surveillance, Looks.from_state(state["looks"]), state["misses"], state["settled"], flipped)

    def add(self, label: str, score: float, chance: float, direction: Direction) -> None:
        """One detection of a class from some direction; ``chance``: how likely it is right."""
        supports = self.robot if direction[0] == "robot" else self.surveillance
        supports.setdefault(label, Support()).add(score)
        self.looks.hit(direction, label, chance)

    def miss(self, direction: Direction) -> None:
        """A robot had the object in plain sight and no detection shows it."""
        self.misses += 1
        self.looks.miss(direction)

    def flip(self, label: str) -> None:
        """Settles on another class than before: a false positive."""
        self.flipped = self.settled, label
        self.settled = label

    def count(self, label: str) -> int:
        """Detections of a class by all sources."""
        return self.robot.get(label, NOTHING).n + self.surveillance.get(label, NOTHING).n

    def absorb(self, other: Evidence) -> None:
        """Adds another object's."""
        for mine, theirs in ((self.robot, other.robot), (self.surveillance, other.surveillance)):
            for label, support in theirs.items():
                mine.setdefault(label, Support()).add(support.score, support.n)
        self.looks.absorb(other.looks)
        self.misses += other.misses
        self.settled = self.settled or other.settled
        self.flipped = self.flipped or other.flipped


def _of_older(state: dict[str, Any]) -> dict[str, Any]:
    """A state of before there were looks: it has the places that classes were seen from, and weights. Its mean scores stand
    for chances."""
    looks, kinds = Looks(), {}
    for name, kind in (("robot", "robot"), ("surveillance", "camera")):
        kinds[name] = {label: [n, n * scores / weight] for label, (n, _, weight, scores, *_) in state[name].items()}
        for label, (_, _, weight, scores, places, *_) in state[name].items():
            for place in places:
                looks.hit((kind, str(place[0] if kind == "camera" else place[-1] // 3)), label, scores / weight)
    flipped = state["flipped"] and state["flipped"][:2]
    return {**state, **kinds, "looks": looks.state(), "flipped": flipped}
