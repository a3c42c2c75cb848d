"""The vocabulary of a detector with a closed set of classes: its names, and what is known of them.

A vocabulary is a folder of ``data``: ``names.json`` (in the order that its detectors number them), ``priors.json`` (what
is known of classes by name, a section for each consumer) and ``rooms.json`` (where things stand). A consumer says what
its section holds with a struct of its own::

    class FusionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        recall: dict[str, float]

    PRIORS = COCO.priors("fusion", FusionPriors)

Names are spelled as ``surveilnav.words.canonical`` spells them. A word that a vocabulary doesn't hold has no priors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from functools import cache
from itertools import product
from pathlib import Path
from typing import TypeVar, overload

import msgspec

from surveilnav.errors import ConfigError, TargetError
from surveilnav.words import canonical

DATA = Path(__file__).parent / "data"

#: Spelled as much alike, a name is near to a word; a part of it counts a little less than the whole.
_NEAR, _PART = 0.7, 0.95

Section = TypeVar("Section", bound=msgspec.Struct)


class Vocabulary(Sequence[str]):
    """The names of a closed set of classes, by number.

    ``name``: what people call the set. ``folder``: where more is known of them; None: nowhere.
    """

    def __init__(self, name: str, names: Sequence[str], folder: Path | None = None) -> None:
        self.name, self._folder = name, folder
        self._names = tuple(names)
        self._numbers = {word: i for i, word in enumerate(self._names)}

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        return self._names[index]

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __contains__(self, word: object) -> bool:
        return word in self._numbers

    def index(self, word: str, start: int = 0, stop: int | None = None) -> int:
        """The number of a name. ValueError: it has none."""
        if word not in self._numbers:
            raise ValueError(f"{word!r} is no name of {self.name}")
        return self._numbers[word]

    def known(self, name: str) -> str:
        """``canonical(name)`` if it is one of the names.

        Raises:
            TargetError: it isn't; the message says which names come nearest.
        """
        if (word := canonical(name)) in self:
            return word
        near = self.nearest(word)
        hint = f"; nearest to it: {', '.join(near)}" if near else ""
        raise TargetError(
            f"{name[:100]!r} is not one of the {len(self)} classes that this detector knows ({self.name}){hint}. "
            "A backend with an open vocabulary finds any word."
        )

    def nearest(self, word: str, most: int = 3) -> list[str]:
        """The names that are spelled most like it, as a whole or in one of their words; the nearest first."""
        alike = {name: max(_alike(word, name), *(_PART * _alike(a, b) for a, b in _pairs(word, name))) for name in self}
        near = sorted((name for name in self if alike[name] >= _NEAR), key=lambda name: -alike[name])
        return near[:most]

    def priors(self, section: str, kind: type[Section]) -> Section:
        """What ``priors.json`` says to one consumer, as its own ``kind`` of struct.

        Raises:
            ConfigError: the file has no such section, or what it says isn't of that kind.
        """
        if self._folder is None:
            raise ConfigError(f"nothing is known of the classes of {self.name}")
        file = self._folder / "priors.json"
        sections = msgspec.json.decode(file.read_bytes(), type=dict[str, msgspec.Raw])
        if section not in sections:
            raise ConfigError(f"{file.name} has no section {section!r}; it has {', '.join(sorted(sections))}")
        try:
            return msgspec.json.decode(sections[section], type=kind)
        except msgspec.DecodeError as error:
            raise ConfigError(f"section {section!r} of {file.name} isn't what {kind.__name__} says: {error}") from error

    def rooms(self) -> dict[str, list[int]]:
        """By name, how readily it stands in a kitchen, living room, bedroom, bathroom: 0 never, 1 sometimes, 2 usually."""
        if self._folder is None:
            return {}
        weights = msgspec.json.decode((self._folder / "rooms.json").read_bytes())["weights"]
        return {str(name): [int(w) for w in row] for name, row in weights.items()}


def _alike(a: str, b: str) -> float:
    return SequenceMatcher(None, a, b).ratio()


def _pairs(a: str, b: str) -> Iterator[tuple[str, str]]:
    return product(a.split(), b.split())


@cache
def load(name: str) -> Vocabulary:
    """The vocabulary in ``data/<name>``."""
    names = msgspec.json.decode((DATA / name / "names.json").read_bytes(), type=list[str])
    return Vocabulary(name.upper(), names, DATA / name)


#: The 80 classes of COCO (Lin et al. 2014), in today's spelling.
COCO = load("coco")
