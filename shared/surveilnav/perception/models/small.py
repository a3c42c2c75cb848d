"""The weights that services load unasked, and which of them lie here."""

from __future__ import annotations

from functools import cache

from surveilnav.perception.models.catalogue import CATALOGUE
from surveilnav.perception.models.find import MOST_UNASKED_BYTES, model_id, survey


@cache
def small_weights() -> tuple[str, ...]:
    """Ids of the models that lie here and that services load unasked. Those that come later count from the next start.

    Raises:
        PerceptionError: a file can't be read.
    """
    small = (model.name for model in CATALOGUE.values() if model.size_bytes <= MOST_UNASKED_BYTES)
    seen = {name: survey(name) for name in small}
    return tuple(model_id(name, s.path) for name, s in seen.items() if s.path is not None and not s.fault)
