"""What thing a name says, in any of the languages of ``data/words.json``.

A name is read by the language that knows most of its words. Whole words count, never parts of them; the longest phrase
wins ("bedside table" is no bed). Of several things the head of the name is meant: the last one in English, German or
Chinese ("desk lamp", "Nachttischlampe"), the first one in French or Russian ("lampe de bureau"). What follows a "with" or
"of" only tells more about what stands before it ("washbasin with cabinet").
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

#: In the table: what names a part of a thing, not a thing ("leg", "pillow").
PART = "part"
#: Longer names are cut: nobody names a chair in more words, and a foreign file may hold any name.
_MAX_NAME_CHARS = 200
#: So many names tell a home's language.
_MAX_NAMES = 500
#: What stands before an ending makes a compound with it ("Doppel-bett"), unless it is shorter than this.
_MIN_COMPOUND_START = 3

#: A word: a sign of Chinese or Japanese, else letters.
_CJK = "\u3040-\u30ff\u3400-\u9fff\uf900-\ufaff"
_WORD = re.compile(rf"[{_CJK}]|[^\W\d_{_CJK}]+")
_POSSESSIVE = re.compile(r"['\u2019]s\b", re.IGNORECASE)
#: What stands after one of these tells more about what stands before it.
_STOP = re.compile(r"[,;:()\[\]/&+|]")
#: Voicing marks of Japanese tell words apart; accents do too, but people leave them out.
_KEPT_MARKS = "\u3099\u309a"


@dataclass(frozen=True, slots=True)
class Language:
    """The words of a language by thing ("" for a thing without a class or kind): see ``data/words.json``."""

    code: str
    phrases: dict[tuple[str, ...], str]
    endings: dict[str, str]
    links: frozenset[str]
    is_head_first: bool
    keeps_accents: bool
    longest: int

    def at(self, words: Sequence[str], start: int) -> tuple[str, int] | None:
        """The thing of the longest phrase that begins there, and how many words it has."""
        for length in range(min(self.longest, len(words) - start), 0, -1):
            thing = self.phrases.get(tuple(words[start : start + length]))
            if thing is not None:
                return thing, length
        word = words[start]
        if word in self.links:
            return None
        thing = self.phrases.get((word[:-1],)) if word.endswith("s") else None
        thing = self._of_compound(word) if thing is None else thing
        return None if thing is None else (thing, 1)

    def _of_compound(self, word: str) -> str | None:
        ends = (word[i:] for i in range(_MIN_COMPOUND_START, len(word)))
        return next((self.endings[end] for end in ends if end in self.endings), None)


@dataclass(frozen=True, slots=True)
class _Reading:
    """A name as a language reads it."""

    head: str | None
    things: tuple[str, ...] = ()
    #: How many of its words the language knows, longer phrases first.
    known: tuple[int, int] = (0, 0)
    n_links: int = 0
    #: Whether it knows each of them.
    is_whole: bool = False


def thing_named(name: str, language: str = "") -> str | None:
    """The class or the kind of furniture that a name says; "" for another thing, None for words that no language knows.

    Args:
        name: in any language.
        language: code of the one that reads it where several know as much of it ("Bank", "стол"); "" for the one that
            more people use.
    """
    head = _best(name[:_MAX_NAME_CHARS], language).head
    return "" if head == PART else head


def thing_asked_for(phrase: str) -> str:
    """The class or the kind of thing that a person's phrase names, every word of it; "" if one is unknown, or it names none.

    It also knows what is no furniture ("Tür", "escalier").
    """
    if len(phrase) > _MAX_NAME_CHARS:
        return ""
    best = _best(phrase, "", asked=True)
    return best.head if best.head and best.head != PART and best.is_whole else ""


def phrases_by_thing() -> dict[str, tuple[str, ...]]:
    """By thing, the phrases of all languages that a person may ask for it by."""
    phrases: dict[str, dict[str, None]] = {}
    for row in _table()["languages"].values():
        for thing, listed in (*row["things"].items(), *row["also"].items()):
            phrases.setdefault(thing, {}).update(dict.fromkeys(listed.replace("-", "").split(", ")))
    return {thing: tuple(listed) for thing, listed in phrases.items() if thing not in ("", PART)}


def whole_of(name: str) -> str | None:
    """What a name says that a thing is, or is a part of: "Bed_2", "BedLeg", "leg of a bed", "bed sheet" -> "bed"."""
    name = name[:_MAX_NAME_CHARS]
    best = _best(name, "")
    if best.head != PART:
        return best.head
    whole = next((thing for thing in reversed(best.things) if thing and thing != PART), None)
    return whole or thing_named(" ".join(split_words(name, keeps_accents=True)[:-1])) or ""


def detect_language(names: Iterable[str]) -> str:
    """The code of the language that most of some names are written in, such as those of a home's furniture."""
    names = list(islice(dict.fromkeys(name[:_MAX_NAME_CHARS] for name in names), _MAX_NAMES))
    known = {language.code: sum(bool(_read(name, language).things) for name in names) for language in _languages()}
    return max(known, key=lambda code: known[code])


def things() -> frozenset[str]:
    """All classes and kinds of furniture that the table has words for."""
    return frozenset(thing for row in _table()["languages"].values() for thing in row["things"]) - {"", PART}


def split_words(text: str, keeps_accents: bool = False) -> tuple[str, ...]:
    """The words of a text in lower case, without accents unless they are kept: "DoubleBed_2" -> ("double", "bed")."""
    spaced = split_camel_case(_POSSESSIVE.sub("", unicodedata.normalize("NFKC", text)))
    folded = spaced.casefold() if keeps_accents else _without_accents(spaced.casefold())
    return tuple(_WORD.findall(unicodedata.normalize("NFC", folded)))


def split_camel_case(text: str) -> str:
    """Spaces before the capitals that begin a word: "TVStand" -> "TV Stand"."""
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
    return tuple(split_words(part, keeps_accents) for part in _STOP.split(name))


@lru_cache(maxsize=4096)
def _best(name: str, language: str, asked: bool = False) -> _Reading:
    """The reading of the language that knows most of a name; the first of equals, they stand in order of use."""
    read = [(_read(name, known), known.code == language) for known in _languages(asked)]
    return max(read, key=lambda r: (r[0].known, r[1], r[0].n_links))[0]


def _read(name: str, language: Language) -> _Reading:
    """The head of the first part that names a thing."""
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
    """What a language knows of some words, in order: things, None for links, each with its number of words."""
    at = 0
    while at < len(words):
        match = language.at(words, at)
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
    """Who names a thing with one of these words names a note about it."""
    return frozenset(_table()["annotations"].split(", "))


@cache
def _languages(asked: bool = False) -> tuple[Language, ...]:
    """All, in order of use; ``asked``: with what a person may ask for beside furniture."""
    return tuple(_language(code, row, asked) for code, row in _table()["languages"].items())


def _language(code: str, row: dict, asked: bool) -> Language:
    keeps_accents = row.get("accents") == "kept"
    phrases: dict[tuple[str, ...], str] = {}
    endings: dict[str, str] = {}
    for thing, listed in (*row["things"].items(), *(row["also"].items() if asked else ())):
        for phrase in listed.split(", "):
            words = split_words(phrase, keeps_accents)
            phrases[words] = thing
            if phrase.startswith("-"):
                endings[words[0]] = thing
    links = frozenset(split_words(row["links"], keeps_accents))
    return Language(code, phrases, endings, links, row["head"] == "first", keeps_accents, max(map(len, phrases)))
