"""Finds models on this machine (first in SURVEILNAV_MODELS_DIR, then in the cache), and downloads small ones."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from surveilnav.config import models_dir, path_from_env
from surveilnav.errors import PerceptionError
from surveilnav.perception.models import check, hashes
from surveilnav.perception.models.catalogue import CATALOGUE, Model, model_called
from surveilnav.perception.models.pull import pull, pull_folder
from surveilnav.perception.models.transfer import OnProgress

#: Larger models are only fetched by `surveilnav models pull`: nobody expects gigabytes because a service starts.
MAX_UNASKED_BYTES = 100_000_000


@dataclass(frozen=True, slots=True)
class LocalModel:
    """What is on this machine under a model's name. ``path``: None where nothing is; ``fault``: what is wrong with it, or ""."""

    path: Path | None = None
    fault: str = ""


def find(name: str, *, download: bool = True, on_progress: OnProgress | None = None) -> Path:
    """The file or folder of a model, checked.

    Args:
        name: of the catalogue; or a folder's name in SURVEILNAV_MODELS_DIR; or a folder's path (with a slash in it).
        download: whether it may be fetched if it isn't on this machine and has at most ``MAX_UNASKED_BYTES``.

    Raises:
        PerceptionError: it isn't on this machine and can't be downloaded, or what is there is something else.
    """
    custom = _custom_path(name)
    if custom is not None:
        return check.checked_custom(custom)
    model = model_called(name)
    path, small = _present(model), model.size_bytes <= MAX_UNASKED_BYTES
    if path is not None and not (download and small and _half_pulled(path, model)):
        return check.checked(path, model)
    if not (download and small and model.source):
        raise PerceptionError(_not_here(model, download))
    return pull(name, on_progress=on_progress)


def family(name: str) -> str:
    """Which loader a model needs: its family in the catalogue, or the ``model_type`` in the config.json of another folder.

    Raises:
        PerceptionError: there is no such model, or its config.json says nothing.
    """
    custom = _custom_path(name)
    if custom is None:
        return model_called(name).family
    check.expect_exists(custom)
    return check.model_type(custom) if custom.is_dir() else check.family_of_file(custom)


def model_id(name: str, path: Path) -> str:
    """``name@hash8``: identifies the weights that made an embedding, so that embeddings of different ones are never compared.

    Args:
        name: as given to ``find``; of a path, its last part counts.
        path: what ``find`` returned. The hash is of its weights' content, and remembered by path, size and time.

    Raises:
        PerceptionError: it can't be read.
    """
    files = check.weights_of(path) if path.is_dir() else [path]
    try:
        digests = [hashes.sha256(file) for file in files]
    except OSError as error:
        raise PerceptionError(f"the weights in {path} can't be read: {error.strerror}") from error
    if not digests:
        raise PerceptionError(f"{path} has no weights: expected model.safetensors or pytorch_model.bin in it")
    digest = digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    return f"{Path(name).name}@{digest[:8]}"


def is_here(name: str) -> bool:
    """Whether anything is on this machine under a name of the catalogue, unchecked. PerceptionError: there is no such model."""
    return _present(model_called(name)) is not None


def survey(name: str, *, anew: bool = False) -> LocalModel:
    """What is on this machine of a model. It never downloads, and raises nothing for what is wrong with the model itself.

    Args:
        name: as for ``find``.
        anew: hash all of it again, whatever hashes are remembered.

    Raises:
        PerceptionError: there is no model of that name.
    """
    custom = _custom_path(name)
    path = custom if custom is not None else _present(model_called(name))
    if path is None:
        return LocalModel()
    try:
        return LocalModel(check.checked_custom(path) if custom else check.checked(path, model_called(name), anew=anew))
    except PerceptionError as error:
        return LocalModel(path, str(error))


@cache
def small_weights() -> tuple[str, ...]:
    """Ids of the models that are on this machine and small enough to be loaded unasked. Those that come later count from the
    next start.

    Raises:
        PerceptionError: a file can't be read.
    """
    small = (model.name for model in CATALOGUE.values() if model.size_bytes <= MAX_UNASKED_BYTES)
    local = {name: survey(name) for name in small}
    return tuple(model_id(name, m.path) for name, m in local.items() if m.path is not None and not m.fault)


def _not_here(model: Model, download: bool) -> str:
    """The message that a model isn't on this machine, and how to get it there."""
    if model.built_in:
        return (
            f"the weights of {model.name} don't come with this version of SurveilNav; {model.setting} can name a file"
        )
    how = f"`surveilnav models pull {model.name}` fetches it." if model.source else model.note
    if download and model.source:
        mb, max_mb = model.size_bytes / 1e6, MAX_UNASKED_BYTES / 1e6
        how = f"It has {mb:,.0f} MB, and only models of up to {max_mb:.0f} MB are fetched unasked: {how}"
    return f"{model.path} isn't on this machine. {how}"


def _present(model: Model) -> Path | None:
    """The first place where something is under a model's name, unchecked; None if there is none."""
    return next((path for path in _places(model) if path.exists() or path.is_symlink()), None)


def _places(model: Model) -> Iterator[Path]:
    """The places where a model may be, in the order in which they are searched."""
    custom = path_from_env(model.setting) if model.setting else None
    if custom is not None:
        yield custom
        return
    if model.built_in:
        yield model.built_in_path
        return
    given = models_dir()
    if given is not None:
        yield given / model.path
    yield pull_folder() / model.path


def _half_pulled(path: Path, model: Model) -> bool:
    """Whether a pull into the cache was interrupted between two files."""
    return path.parent == pull_folder() and model.is_folder and bool(list(check.missing_files(path, model)))


def _custom_path(name: str) -> Path | None:
    """The path that ``name`` means if it isn't of the catalogue: a path, or a folder's name in SURVEILNAV_MODELS_DIR."""
    if "/" in name or "\\" in name:
        return Path(name).expanduser()
    given = models_dir()
    catalogued = name in CATALOGUE and CATALOGUE[name].is_folder
    try:
        if name and not catalogued and given is not None and (given / name).is_dir():
            return given / name
    except OSError as error:
        raise PerceptionError(f"SURVEILNAV_MODELS_DIR is {given}, which can't be read: {error.strerror}") from error
    return None
