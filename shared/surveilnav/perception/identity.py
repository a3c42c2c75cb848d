"""Names for all that decides what backends say, so that what they said can be kept between runs."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from surveilnav.perception import models
from surveilnav.perception.models.find import MOST_UNASKED_BYTES


@cache
def package_id() -> str:
    """A hash of this package with its data: another version may say something else of the same picture."""
    whole, package = hashlib.sha256(), Path(__file__).parent
    for file in sorted(path for path in package.rglob("*") if path.suffix in (".py", ".json", ".onnx")):
        whole.update(f"{file.relative_to(package)} {file.stat().st_size} ".encode())
        whole.update(file.read_bytes())
    return whole.hexdigest()


@cache
def small_weights() -> tuple[str, ...]:
    """Ids of the models that lie here and that services load unasked. Those that come later count from the next start."""
    small = (model.name for model in models.CATALOGUE.values() if model.size_bytes <= MOST_UNASKED_BYTES)
    seen = {name: models.survey(name) for name in small}
    return tuple(models.model_id(name, s.path) for name, s in seen.items() if s.path is not None and not s.fault)
