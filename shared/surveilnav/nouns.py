"""Which object a name or phrase means, in the languages of ``data/words.json``.

A name is read in the language that knows most of its words. Only whole words count, and the longest known phrase wins
("bedside table" is no bed). If a name mentions several objects, its head noun is meant: the last one in English, German or
Chinese ("desk lamp", "Nachttischlampe"), the first one in French or Russian ("lampe de bureau"). What follows "with" or "of"
only describes what precedes it ("washbasin with cabinet").

A "thing" is a class of objects or a kind of furniture of the table.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from itertools import islice

#: The thing of words that name a part of an object ("leg", "pillow").
PART = "part"
#: Longer names are cut. Files of others may contain names of any length.
_MAX_NAME_CHARS = 200
#: Number of names that are enough to detect the language of a home.
_MAX_NAMES = 500
#: Minimal length of the first part of a compound word ("Doppel-bett").
_MIN_COMPOUND_START = 3

#: A word is one Chinese or Japanese character, or a run of letters.
_CJK = "\u3040-\u30ff\u3400-\u9fff\uf900-\ufaff"
_WORD = re.compile(rf"[{_CJK}]|[^\W\d_{_CJK}]+")
_POSSESSIVE = re.compile(r"['\u2019]s\b", re.IGNORECASE)
#: What follows one of these only describes what precedes it.
_SEPARATOR = re.compile(r"[,;:()\[\]/&+|]")
#: Japanese voicing marks are kept because they distinguish words. Accents do, too, but people often omit them.
_KEPT_MARKS = "\u3099\u309a"


@dataclass(frozen=True, slots=True)
class Language:
    """The words of one language; see ``data/words.json``.

    Attributes:
        phrases: by phrase, as a tuple of words, its thing; "" for things without a class or kind.
        endings: by ending of compound words, its thing.
        links: words such as "with" and "of".
        is_head_first: whether the first noun of a name is its head, not the last.
        keeps_accents: whether accents distinguish words.
        longest: number of words of the longest phrase.
    """

    code: str
    phrases: dict[tuple[str, ...], str]
    endings: dict[str, str]
    links: frozenset[str]
    is_head_first: bool
    keeps_accents: bool
    longest: int

    def match_at(self, words: Sequence[str], start: int) -> tuple[str, int] | None:
        """The thing of the longest phrase that begins at ``start``, and the phrase's number of words; None if there is none."""
        for length in range(min(self.longest, len(words) - start), 0, -1):
            thing = self.phrases.get(tuple(words[start : start + length]))
            if thing is not None:
                return thing, length
        word = words[start]
        if word in self.links:
            return None
        thing = self.phrases.get((word[:-1],)) if word.endswith("s") else None
        thing = self._thing_of_compound(word) if thing is None else thing
        return None if thing is None else (thing, 1)

    def _thing_of_compound(self, word: str) -> str | None:
        ends = (word[i:] for i in range(_MIN_COMPOUND_START, len(word)))
        return next((self.endings[end] for end in ends if end in self.endings), None)


@dataclass(frozen=True, slots=True)
class _Reading:
    """How a language reads a name.

    Attributes:
        head: the thing that is meant; None if the language knows no word of the name.
        things: all things that the name mentions.
        known: number of known words, and the sum of squares over known phrases, which favours longer phrases.
        n_links: number of links.
        is_complete: whether the language knows every word.
    """

    head: str | None
    things: tuple[str, ...] = ()
    known: tuple[int, int] = (0, 0)
    n_links: int = 0
    is_complete: bool = False


def thing_named(name: str, language: str = "") -> str | None:
    """The thing that a name means; "" for an object without a class or kind, None if no language knows a word of it.

    Args:
        language: code of the language that decides if several know as many words of the name ("Bank", "стол"); "": the one
            that more people use.
    """
    head = _best(name[:_MAX_NAME_CHARS], language).head
    return "" if head == PART else head


def thing_asked_for(phrase: str) -> str:
    """The thing that a person's phrase means; "" if it means none, or if one of its words is unknown.

    Besides furniture it knows parts of the building ("Tür", "escalier").
    """
    if len(phrase) > _MAX_NAME_CHARS:
        return ""
    best = _best(phrase, "", wide=True)
    return best.head if best.head and best.head != PART and best.is_complete else ""


def phrases_by_thing() -> dict[str, tuple[str, ...]]:
    """By thing, the phrases of all languages with which a person may ask for it."""
    phrases: dict[str, dict[str, None]] = {}
    for row in _table()["languages"].values():
        for thing, listed in (*row["things"].items(), *row["also"].items()):
            phrases.setdefault(thing, {}).update(dict.fromkeys(listed.replace("-", "").split(", ")))
    return {thing: tuple(listed) for thing, listed in phrases.items() if thing not in ("", PART)}


def thing_or_whole(name: str) -> str | None:
    """``thing_named``, or for a part the thing that it belongs to: "Bed_2", "BedLeg", "leg of a bed", "bed sheet" -> "bed"."""
    name = name[:_MAX_NAME_CHARS]
    best = _best(name, "")
    if best.head != PART:
        return best.head
    whole = next((thing for thing in reversed(best.things) if thing and thing != PART), None)
    return whole or thing_named(" ".join(split_words(name, keeps_accents=True)[:-1])) or ""


def detect_language(names: Iterable[str]) -> str:
    """The code of the language in which most of the names are written, such as those of a home's furniture."""
    names = list(islice(dict.fromkeys(name[:_MAX_NAME_CHARS] for name in names), _MAX_NAMES))
    known = {language.code: sum(bool(_read(name, language).things) for name in names) for language in _languages()}
    return max(known, key=lambda code: known[code])


def things() -> frozenset[str]:
    """All things of the table, without those that are no furniture."""
    return frozenset(thing for row in _table()["languages"].values() for thing in row["things"]) - {"", PART}


def split_words(text: str, keeps_accents: bool = False) -> tuple[str, ...]:
    """The words of a text in lower case, by default without accents: "DoubleBed_2" -> ("double", "bed")."""
    spaced = split_camel_case(_POSSESSIVE.sub("", unicodedata.normalize("NFKC", text)))
    folded = spaced.casefold() if keeps_accents else _without_accents(spaced.casefold())
    return tuple(_WORD.findall(unicodedata.normalize("NFC", folded)))


def split_camel_case(text: str) -> str:
    """Inserts spaces before capitals that begin a word: "TVStand" -> "TV Stand"."""
    around = zip(" " + text, text, text[1:] + " ", strict=False)
    starts = (
        c.isupper() and (last.islower() or (last.isupper() and following.islower())) for last, c, following in around
    )
    return "".join(f" {c}" if start else c for c, start in zip(text, starts, strict=True))


def _without_accents(text: str) -> str:
    marked = unicodedata.normalize("NFD", text).replace("ı", "i")
    return "".join(c for c in marked if unicodedata.category(c) != "Mn" or c in _KEPT_MARKS)


@lru_cache(maxsize=4096)
def _parts(name: str, keeps_accents: bool) -> tuple[tuple[str, ...], ...]:
    return tuple(split_words(part, keeps_accents) for part in _SEPARATOR.split(name))


@lru_cache(maxsize=4096)
def _best(name: str, language: str, wide: bool = False) -> _Reading:
    """The reading of the language that knows most of a name; of equals, the most used language. ``wide``: see ``_languages``."""
    read = [(_read(name, known), known.code == language) for known in _languages(wide)]
    return max(read, key=lambda r: (r[0].known, r[1], r[0].n_links))[0]


def _read(name: str, language: Language) -> _Reading:
    """Reads a name in one language. Its head is that of the first part that names a thing."""
    parts = _parts(name, language.keeps_accents)
    if any(word in _annotations() for part in parts for word in part):
        return _Reading("")
    phrases: list[list[tuple[str, int]]] = [[]]
    n_links = 0
    for part in parts:
        for thing, length in _known(part, language):
            if thing is None:
                n_links += length
                phrases.append([])
            else:
                phrases[-1].append((thing, length))
        phrases.append([])
    head = next((_head([thing for thing, _ in phrase], language) for phrase in phrases if phrase), None)
    found = [match for phrase in phrases for match in phrase]
    lengths = [length for _, length in found]
    known = (sum(lengths), sum(n * n for n in lengths))
    return _Reading(head, tuple(t for t, _ in found), known, n_links, sum(map(len, parts)) == known[0] + n_links)


def _head(things: Sequence[str], language: Language) -> str:
    return things[0] if language.is_head_first else things[-1]


def _known(words: Sequence[str], language: Language) -> Iterator[tuple[str | None, int]]:
    """The things that a language knows in ``words``, in order, each with its number of words; None for links."""
    at = 0
    while at < len(words):
        match = language.match_at(words, at)
        if match is not None:
            yield match
            at += match[1]
            continue
        if words[at] in language.links:
            yield None, 1
        at += 1


@cache
def _table() -> dict:
    text = resources.files("surveilnav").joinpath("data/words.json").read_text("utf-8")
    table: dict = json.loads(text)
    return table


@cache
def _annotations() -> frozenset[str]:
    """Words that mark a name as an annotation, not as an object."""
    return frozenset(_table()["annotations"].split(", "))


@cache
def _languages(wide: bool = False) -> tuple[Language, ...]:
    """All languages, the most used first. ``wide``: with words for more than furniture, for people's requests."""
    return tuple(_language(code, row, wide) for code, row in _table()["languages"].items())


def _language(code: str, row: dict, wide: bool) -> Language:
    keeps_accents = row.get("accents") == "kept"
    phrases: dict[tuple[str, ...], str] = {}
    endings: dict[str, str] = {}
    for thing, listed in (*row["things"].items(), *(row["also"].items() if wide else ())):
        for phrase in listed.split(", "):
            words = split_words(phrase, keeps_accents)
            phrases[words] = thing
            if phrase.startswith("-"):
                endings[words[0]] = thing
    links = frozenset(split_words(row["links"], keeps_accents))
    return Language(code, phrases, endings, links, row["head"] == "first", keeps_accents, max(map(len, phrases)))
