"""How the searches of a run are told apart: by what cameras knew, class, building, length."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from surveilnav.benchmark.dataset.splits import is_real_home
from surveilnav.benchmark.runner.row import EpisodeRecord

_KINDS = {"flats": "apartment houses (generated)", "office": "offices (generated)"}
_DRAWN = "homes and others that people drew"
#: From this chance on the cameras' views show the target well: as likely as not it is there.
_LIKELY = 0.5
_NO_CAMERAS, _UNSEEN = "no cameras took part", "not at all"
_UNSURE, _SEEN = f"with a chance below {_LIKELY:.0%}", f"with a chance of {_LIKELY:.0%} or more"


@dataclass(frozen=True, slots=True)
class Grouping:
    """One way to tell searches apart. ``order``: the names of its groups in the order of the page; others follow by name."""

    title: str
    about: str
    group_of: Callable[[EpisodeRecord], str]
    order: tuple[str, ...] = ()
    in_picture: bool = True

    def groups(self, records: Sequence[EpisodeRecord]) -> dict[str, list[EpisodeRecord]]:
        """The searches by group; groups without any are left out."""
        found: dict[str, list[EpisodeRecord]] = {}
        for record in records:
            found.setdefault(self.group_of(record), []).append(record)
        rank = {name: i for i, name in enumerate(self.order)}
        return {name: found[name] for name in sorted(found, key=lambda name: (rank.get(name, len(rank)), name))}


def _known_to_cameras(record: EpisodeRecord) -> str:
    chance = record.camera_chance
    if chance is None:
        return _NO_CAMERAS
    return _UNSEEN if chance <= 0.0 else _UNSURE if chance < _LIKELY else _SEEN


def kind_of(scene: str) -> str:
    """The kind of a scene's building."""
    if is_real_home(scene):
        return _DRAWN
    kind = scene.rpartition("-s")[0].rpartition("_")[0]
    return _KINDS.get(kind, kind)


def _between(edges: Sequence[int], unit: str) -> tuple[tuple[str, ...], Callable[[float], str]]:
    """Names of the spans that ``edges`` cut, and which of them a number lies in; an edge belongs to the span below it."""
    names = [f"up to {edges[0]} {unit}"]
    names += [f"over {low} to {high} {unit}" for low, high in itertools.pairwise(edges)]
    names.append(f"over {edges[-1]} {unit}")
    return tuple(names), lambda value: names[sum(value > edge for edge in edges)]


_STEPS, _steps_of = _between((50, 100, 200), "steps")
_PATHS, _path_of = _between((5, 10, 20), "m")

GROUPINGS: tuple[Grouping, ...] = (
    Grouping(
        "By what the cameras see at the start",
        "Whether the joint maps that the cameras of the floor make alone hold an object where a goal is, and with what chance of "
        "being the target.",
        _known_to_cameras,
        (_SEEN, _UNSURE, _UNSEEN, _NO_CAMERAS),
    ),
    Grouping("By kind of building", "Read from the name of the scene.", lambda r: kind_of(r.scene), (_DRAWN,)),
    Grouping("By target", "The class that is searched for.", lambda r: r.category),
    Grouping(
        "By length of the shortest path",
        "From the start to the nearest goal. It says how hard a search is before it begins.",
        lambda r: _path_of(r.shortest_path_m),
        _PATHS,
        in_picture=False,
    ),
    Grouping(
        "By steps that the search took",
        "Long searches are bad ones, so this says how the loss is spread and not why it is there.",
        lambda r: _steps_of(r.steps),
        _STEPS,
        in_picture=False,
    ),
)
