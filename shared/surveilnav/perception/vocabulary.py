"""The vocabulary of a detector with a closed set of classes: their names, and prior knowledge about them.

A vocabulary is a folder of ``data``: ``names.json`` (the classes in the order of its detectors' outputs), ``priors.json``
(prior knowledge by class, in a section for each consumer) and ``rooms.json`` (in which rooms objects stand). A consumer
declares the content of its section as a struct::

    class FusionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        recall: dict[str, float]

    PRIORS = COCO.priors("fusion", FusionPriors)

Names have the canonical spelling of ``surveilnav.words``. People's words for a class are understood in all languages of
``surveilnav.nouns`` (``find_name``, ``resolve_name``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from functools import cache, cached_property
from itertools import chain, product
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar, overload

import msgspec

from surveilnav.errors import ConfigError, TargetError
from surveilnav.nouns import phrases_by_thing, thing_asked_for, thing_or_whole
from surveilnav.words import MAX_WORD_CHARS, canonical

DATA = Path(__file__).parent / "data"

#: Similarity of spelling from which a class is suggested for a word, and the weight of the similarity of single words.
_NEAR, _PART = 0.7, 0.95
#: The same for synonyms, of which there are thousands.
_NEAR_SYNONYM = 0.8

#: The kinds of rooms in the order of ``rooms.json``, and the weight of objects that usually stand there.
ROOMS = ("kitchen", "living room", "bedroom", "bathroom")
_USUALLY = 2

_NO_MEANINGS: Mapping[str, str] = MappingProxyType({})
_NO_KIN: Mapping[str, Sequence[str]] = MappingProxyType({})

Section = TypeVar("Section", bound=msgspec.Struct)


class Vocabulary(Sequence[str]):
    """The names of a closed set of classes, by number.

    Args:
        name: name of the set, for people.
        names: the classes.
        folder: folder with prior knowledge; None: there is none.
        meanings: by other words, the class that each means ("chest": "chest of drawers").
        akin: by words that mean no class, the classes nearest in meaning ("kitchen": oven, sink, ...).
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
        """The number of a class. Raises ValueError if there is no such class."""
        if word not in self._numbers:
            raise ValueError(f"{word!r} is no name of {self.name}")
        return self._numbers[word]

    def exact_name(self, word: str) -> str:
        """The class that a word is, or means by ``meanings``; empty if none. Unlike ``find_name`` it knows no other languages."""
        word = canonical(word)
        return word if word in self else self._meanings.get(word, "")

    def find_name(self, name: str) -> str:
        """The class that a person's word means, in any spelling or language ("Sofa", "canapé", "床"); empty if none."""
        word = canonical(name)
        names = (self.exact_name(w) for w in (word, thing_asked_for(name), thing_asked_for(word)))
        return next(filter(None, names), "")

    def resolve_name(self, name: str) -> str:
        """``find_name``, or an error.

        Raises:
            TargetError: the word means no class; the message suggests the nearest ones.
        """
        if own := self.find_name(name):
            return own
        near = self.nearest(name)
        hint = f"; nearest are {', '.join(near)}" if near else ""
        raise TargetError(
            f"{name[:100]!r} is not in this model's vocabulary ({self.name}, {len(self)} classes){hint}. "
            "A backend with an open vocabulary finds any word."
        )

    def nearest(self, word: str, max_names: int = 3) -> list[str]:
        """The classes nearest to a word, nearest first: by meaning if known (``akin``), then by spelling.

        The spelling of the word, or of the thing that it means, is compared with a class's name, its single words, and its
        synonyms.
        """
        word, thing = canonical(word)[:MAX_WORD_CHARS], thing_asked_for(word)
        spellings = [thing] if thing else [word, thing_or_whole(word) or word]
        similarity = {name: max(self._similarity(s, name) for s in spellings) for name in self}
        near = sorted((name for name in self if similarity[name] > 0), key=lambda name: -similarity[name])
        return list(dict.fromkeys((*self._akin.get(word, ()), *near)))[:max_names]

    def _similarity(self, word: str, name: str) -> float:
        """Similarity of a word's spelling to a class's name or synonyms, 0-1; 0 if it is below the thresholds."""
        own = max(
            [_similarity(word, name), *(_PART * _similarity(a, b) for a, b in product(word.split(), name.split()))]
        )
        other = max((_similarity(word, phrase, _NEAR_SYNONYM) for phrase in self._phrases[name]), default=0.0)
        return max(own if own >= _NEAR else 0.0, other)

    @cached_property
    def _phrases(self) -> dict[str, tuple[str, ...]]:
        """By class, its synonyms in all languages."""
        phrases = phrases_by_thing()
        others: dict[str, list[str]] = {name: [] for name in self}
        for word, name in self._meanings.items():
            others[name].append(word)
        return {
            name: tuple(chain.from_iterable(phrases.get(thing, ()) for thing in (name, *others[name]))) for name in self
        }

    def priors(self, section: str, kind: type[Section]) -> Section:
        """A section of ``priors.json``, as a struct of type ``kind``.

        Raises:
            ConfigError: there is no such section, or it doesn't fit the struct.
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
        """By class, whether it stands in each of the ``ROOMS``: 0 never, 1 sometimes, 2 usually."""
        return {} if self._folder is None else _weights(self._folder)


def _weights(folder: Path) -> dict[str, list[int]]:
    weights = msgspec.json.decode((folder / "rooms.json").read_bytes())["weights"]
    return {str(name): [int(w) for w in row] for name, row in weights.items()}


def _similarity(a: str, b: str, minimum: float = 0.0) -> float:
    """Similarity of two spellings, 0-1; 0 if it is below ``minimum``."""
    matcher = SequenceMatcher(None, a, b)
    if minimum and (matcher.real_quick_ratio() < minimum or matcher.quick_ratio() < minimum):
        return 0.0
    ratio = matcher.ratio()
    return ratio if ratio >= minimum else 0.0


@cache
def load(name: str) -> Vocabulary:
    """The vocabulary in ``data/<name>``."""
    folder = DATA / name
    names = msgspec.json.decode((folder / "names.json").read_bytes(), type=list[str])
    weights = _weights(folder)
    # objects that stand in few other rooms are typical of a room
    typical = sorted((n for n in names if n in weights), key=lambda n: sum(weights[n]))
    akin = {room: [n for n in typical if weights[n][i] == _USUALLY] for i, room in enumerate(ROOMS)}
    return Vocabulary(name.upper(), names, folder, akin=akin)


#: The 80 classes of COCO (Lin et al. 2014), in canonical spelling.
COCO = load("coco")
