"""Which buildings make which split, and how many episodes. ``train`` shares neither plans nor furniture with ``val``.

Settings and the error model of ``simulated`` were fitted on ``train``; the generator's room statistics come from its homes.
(The score thresholds of ``onnx-coco`` were chosen on six homes, of which ``val`` has two: docs/understand/perception.md.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from surveilnav.errors import ConfigError
from surveilnav.simulator.procedural.buildings import is_generated
from surveilnav.simulator.sources import EXAMPLE_HOMES, TRAIN_HOMES, list_buildings

Models = Literal["all", "train", "val"]

#: Grows with the choice of buildings and with what their rooms, doors and floors are: numbers of two editions aren't of the
#: same searches. v1 had 24 scenes of ``train`` and 12 of ``val_mini``.
EDITION = "v2"

VAL_HOMES = tuple(home for home in EXAMPLE_HOMES if home not in TRAIN_HOMES)
#: Each val home is furnished twice.
VAL_SEEDS = (0, 1)


@dataclass(frozen=True, slots=True)
class SceneSpec:
    """A building with its furniture: a name, or the path of a plan or a mesh. ``seed`` draws furniture and floor coverings."""

    building: str
    seed: int
    models: Models

    @property
    def scene(self) -> str:
        """Its name in a dataset's files."""
        return f"{Path(self.building).stem}-s{self.seed}"


@dataclass(frozen=True, slots=True)
class SplitSpec:
    """``expected``: (floors, cameras) that the scenes must come out with, None: whatever they have."""

    name: str
    scenes: tuple[SceneSpec, ...]
    episodes: int
    expected: tuple[int, int] | None = None


def quotas(total: int, scenes: int) -> list[int]:
    """``total`` over ``scenes`` as evenly as whole numbers allow, the first ones get one more."""
    each, more = divmod(total, scenes)
    return [each + (i < more) for i in range(scenes)]


def take(available: dict[str, int], wanted: int, first: int = 0) -> dict[str, int]:
    """How many of each category: round and round, beginning with the ``first``, until ``wanted`` or nothing is left."""
    names, taken = list(available), dict.fromkeys(available, 0)
    at = first
    while sum(taken.values()) < min(wanted, sum(available.values())):
        name = names[at % len(names)]
        taken[name] += taken[name] < available[name]
        at += 1
    return taken


def _specs(buildings: Sequence[str], seeds: Sequence[int], models: Models) -> tuple[SceneSpec, ...]:
    return tuple(SceneSpec(b, s, models) for b in buildings for s in seeds)


def is_real_home(scene: str) -> bool:
    """Whether a scene's building was drawn by a person; else our generator drew it."""
    return not is_generated(scene.rpartition("-s")[0])


#: The first 30 candidates by their seeds that give the paper's counts together with the val homes, in v1 and in v2.
VAL_GENERATED = (
    "office_0",
    "flats_0",
    "office_1",
    "flats_1",
    "office_2",
    "flats_2",
    "office_3",
    "flats_3",
    "flats_4",
    "office_5",
    "flats_5",
    "office_6",
    "flats_6",
    "office_7",
    "flats_7",
    "flats_8",
    "office_9",
    "flats_9",
    "office_10",
    "flats_10",
    "office_11",
    "flats_11",
    "office_12",
    "flats_12",
    "flats_13",
    "flats_14",
    "office_15",
    "flats_15",
    "office_16",
    "flats_16",
)
TRAIN_GENERATED = tuple(f"{kind}_{n}" for n in range(1000, 1050) for kind in ("office", "flats"))

_VAL = (*_specs(VAL_HOMES, VAL_SEEDS, "val"), *_specs(VAL_GENERATED, (0,), "val"))
#: Every home once, and every other building of each kind that was generated.
_MINI = (
    *_specs(VAL_HOMES, VAL_SEEDS[:1], "val"),
    *(s for kind in ("office", "flats") for s in _specs([b for b in VAL_GENERATED if kind in b][::2], (0,), "val")),
)
_TRAIN = (*_specs(TRAIN_HOMES, (0, 1), "train"), *_specs(TRAIN_GENERATED, (0,), "train"))

#: A paired difference of two policies has a standard deviation of 25 to 30 points a search: 1,200 searches tell two points.
SPLITS: dict[str, SplitSpec] = {
    split.name: split
    for split in (
        SplitSpec("val", _VAL, 1000, (74, 206)),
        SplitSpec("val_mini", _MINI, 7 * len(_MINI)),
        SplitSpec("train", _TRAIN, 11 * len(_TRAIN)),
    )
}


def splits_of(names: Sequence[str] | None) -> list[SplitSpec]:
    """The splits of these names; all if none is named. ConfigError: one that doesn't exist."""
    unknown = [name for name in names or () if name not in SPLITS]
    if unknown:
        raise ConfigError(f"there is no split {unknown[0]!r}; there are {', '.join(SPLITS)}")
    return [SPLITS[name] for name in names] if names else list(SPLITS.values())


def own_split(name: str, buildings: Sequence[str], episodes_each: int) -> SplitSpec:
    """A split of anybody's buildings.

    Args:
        buildings: names of buildings, paths of plans or meshes, folders of HM3D.

    Raises:
        ConfigError: a name that is taken or can't be a folder's, or two buildings with the same file name.
    """
    if name in SPLITS or not name.replace("_", "").replace("-", "").isalnum():
        raise ConfigError(
            f"a split of your own needs a name of letters and digits other than {', '.join(SPLITS)}; got {name!r}"
        )
    scenes = tuple(SceneSpec(_from_anywhere(building), 0, "all") for building in buildings)
    if len({spec.scene for spec in scenes}) < len(scenes):
        raise ConfigError("two of these buildings have the same name, and a split's scenes are named by it: rename one")
    return SplitSpec(name, scenes, episodes_each * len(scenes))


def _from_anywhere(building: str) -> str:
    """A name as it is, a path made absolute: a scene is opened from wherever the benchmark runs."""
    name = building.strip().lower().replace("-", "_")
    if is_generated(name) or name in {row.name for row in list_buildings()}:
        return name
    try:
        path = Path(building).expanduser().resolve()
        return str(path) if path.exists() else building
    except (OSError, RuntimeError, ValueError) as error:  # too long, no home directory, a zero byte
        raise ConfigError(f"{building[:80]!r} can't be opened: {error}") from error
