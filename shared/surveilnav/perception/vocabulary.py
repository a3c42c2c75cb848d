"""The vocabulary of a detector with a closed set of classes: its names, and what is known of them.

A vocabulary is a folder of ``data``: ``names.json`` (in the order that its detectors number them), ``priors.json`` (what
is known of classes by name, a section for each consumer) and ``rooms.json`` (where things stand). A consumer says what
its section holds with a struct of its own::

    class FusionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        recall: dict[str, float]

    PRIORS = COCO.priors("fusion", FusionPriors)

Names are spelled as ``surveilnav.words.canonical`` spells them. A word that a vocabulary doesn't hold has no priors. People's
words for a name, in any language of ``surveilnav.nouns``, are understood (``known``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar, overload

import msgspec

from surveilnav.errors import ConfigError, TargetError
from surveilnav.nouns import phrases_by_thing, thing_asked_for, whole_of
from surveilnav.words import MAX_WORD_CHARS, canonical

DATA = Path(__file__).parent / "data"

#: Spelled as much alike, a name is near to a word; a part of it counts a little less than the whole.
_NEAR, _PART = 0.7, 0.95
#: The same for people's other words: there are thousands.
_NEAR_SYNONYM = 0.8

#: The kinds of rooms of ``rooms.json``, in its order; what stands there usually has this weight.
ROOMS = ("kitchen", "living room", "bedroom", "bathroom")
_USUALLY = 2

_NO_MEANINGS: Mapping[str, str] = MappingProxyType({})
_NO_KIN: Mapping[str, Sequence[str]] = MappingProxyType({})

Section = TypeVar("Section", bound=msgspec.Struct)


class Vocabulary(Sequence[str]):
    """The names of a closed set of classes, by number.

    Args:
        name: what people call the set.
        folder: where more is known of them; None: nowhere.
        meanings: by another word, the name that it means ("chest": "chest of drawers").
        akin: by a word that it doesn't hold, the names that come nearest in meaning ("kitchen": oven, sink, ...).
    """

    def __init__(
        self,
        name: str,
        names: Sequence[str],
        folder: Path | None = None,
        *,
        meanings: Mapping[str, str] = _NO_MEANINGS,
        akin: Mapping[str, Sequence[str]] = _NO_KIN,
    ) -> None:
        self.name, self._folder, self._akin = name, folder, akin
        self._names = tuple(names)
        self._numbers = {word: i for i, word in enumerate(self._names)}
        self._meanings = {word: name for word, name in meanings.items() if name in self._numbers}

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

    def exact_name(self, word: str) -> str:
        """The name that a word of this program's own is or means; empty: none. It reads no languages (``known`` does)."""
        word = canonical(word)
        return word if word in self else self._meanings.get(word, "")

    def find_name(self, name: str) -> str:
        """The name that a person's word means, in any spelling or language ("Sofa", "canapé", "床"); empty: none."""
        word = canonical(name)
        own = (self.exact_name(said) for said in (word, thing_asked_for(name), thing_asked_for(word)))
        return next(filter(None, own), "")

    def resolve_name(self, name: str) -> str:
        """``understood``.

        Raises:
            TargetError: it means none; the message says which names come nearest.
        """
        if own := self.find_name(name):
            return own
        near = self.nearest(name)
        hint = f"; nearest are {', '.join(near)}" if near else ""
        raise TargetError(
            f"{name[:100]!r} is not in this model's vocabulary ({self.name}, {len(self)} classes){hint}. "
            "A backend with an open vocabulary finds any word."
        )

    def nearest(self, word: str, most: int = 3) -> list[str]:
        """The names that come nearest to a word, the nearest first: in meaning where that is known, else those that it, or
        what it stands for, is spelled most like, as a whole, in a part, or in another word for them."""
        word, asked = canonical(word)[:MAX_WORD_CHARS], thing_asked_for(word)
        said = [asked] if asked else [word, whole_of(word) or word]
        alike = {name: max(self._alike(one, name) for one in said) for name in self}
        near = sorted((name for name in self if alike[name] > 0), key=lambda name: -alike[name])
        return list(dict.fromkeys((*self._akin.get(word, ()), *near)))[:most]

    def _alike(self, word: str, name: str) -> float:
        """How much a word is spelled like a name or another word for it, 0-1; 0: not enough."""
        own = max([_alike(word, name), *(_PART * _alike(a, b) for a, b in _pairs(word, name))])
        other = max((_alike(word, phrase, _NEAR_SYNONYM) for phrase in self._phrases[name]), default=0.0)
        return max(own if own >= _NEAR else 0.0, other)

    @cached_property
    def _phrases(self) -> dict[str, tuple[str, ...]]:
        """By name, what else people call it."""
        phrases = phrases_by_thing()
        others: dict[str, list[str]] = {name: [] for name in self}
        for word, name in self._meanings.items():
            others[name].append(word)
        return {name: tuple(_joined(phrases.get(thing, ()) for thing in (name, *others[name]))) for name in self}

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
        """By name, how readily it stands in a room of each kind of ``ROOMS``: 0 never, 1 sometimes, 2 usually."""
        return {} if self._folder is None else _weights(self._folder)


def _weights(folder: Path) -> dict[str, list[int]]:
    weights = msgspec.json.decode((folder / "rooms.json").read_bytes())["weights"]
    return {str(name): [int(w) for w in row] for name, row in weights.items()}


def _alike(a: str, b: str, least: float = 0.0) -> float:
    """0-1; 0 where it is less than ``least``."""
    matcher = SequenceMatcher(None, a, b)
    if least and (matcher.real_quick_ratio() < least or matcher.quick_ratio() < least):
        return 0.0
    ratio = matcher.ratio()
    return ratio if ratio >= least else 0.0


def _joined(parts: Iterable[Sequence[str]]) -> Iterator[str]:
    return (phrase for part in parts for phrase in part)


def _pairs(a: str, b: str) -> Iterator[tuple[str, str]]:
    return product(a.split(), b.split())


@cache
def load(name: str) -> Vocabulary:
    """The vocabulary in ``data/<name>``."""
    folder = DATA / name
    names = msgspec.json.decode((folder / "names.json").read_bytes(), type=list[str])
    weights = _weights(folder)
    # what stands in the fewest other rooms says most of one
    typical = sorted((n for n in names if n in weights), key=lambda n: sum(weights[n]))
    akin = {room: [n for n in typical if weights[n][i] == _USUALLY] for i, room in enumerate(ROOMS)}
    return Vocabulary(name.upper(), names, folder, akin=akin)


#: The 80 classes of COCO (Lin et al. 2014), in today's spelling.
COCO = load("coco")
