"""What a vision-language model is asked."""

from __future__ import annotations

import re

from surveilnav.perception.backend import Backend
from surveilnav.words import canonical

_PROMPT = re.compile(
    r"\s*(?:it\s+)?seems\s+like\s+there\s+is\s+(?:an?\s+|the\s+)?(?P<name>.+?)\s*[.!]?\s*", re.IGNORECASE
)


def value_prompt(target: str) -> str:
    """The text that a view's embedding is compared with for the value map (the paper's section on it, eq. 2)."""
    return f"seems like there is a {target}"


def named(text: str) -> str:
    """The word that a prompt or a plain name names."""
    match = _PROMPT.fullmatch(text)
    return canonical(match.group("name") if match else text)


def word_refused(backend: Backend, text: str) -> str:
    """Why a backend can't look for the target that a ``value_prompt`` names; empty: it can, or no target is named.

    A plain text is compared with embeddings alone: no detector has to know it.
    """
    return backend.refusal(named(text)) if _PROMPT.fullmatch(text) else ""
