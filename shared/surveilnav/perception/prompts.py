"""The text prompt that views are compared with, and the word that a prompt names."""

from __future__ import annotations

import re

from surveilnav.perception.backend import Backend
from surveilnav.words import canonical

_PROMPT = re.compile(
    r"\s*(?:it\s+)?seems\s+like\s+there\s+is\s+(?:an?\s+|the\s+)?(?P<name>.+?)\s*[.!]?\s*", re.IGNORECASE
)


def value_prompt(target: str) -> str:
    """The text whose embedding is compared with a view's for the value map (eq. 2)."""
    return f"seems like there is a {target}"


def word_in_prompt(text: str) -> str:
    """The canonical word that a ``value_prompt`` or a plain name names."""
    match = _PROMPT.fullmatch(text)
    return canonical(match.group("name") if match else text)


def prompt_refusal(backend: Backend, text: str) -> str:
    """Why a backend can't look for the target that a ``value_prompt`` names, as a sentence for people; empty if it can.

    Also empty for any other text: that is only compared with embeddings, so no detector has to know it.
    """
    return backend.refusal(word_in_prompt(text)) if _PROMPT.fullmatch(text) else ""
