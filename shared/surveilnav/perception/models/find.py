"""Where a model lies on this machine: SURVEILNAV_MODELS_DIR first, then the cache, then a download."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from surveilnav.config import models_dir, path_from_env
from surveilnav.errors import PerceptionError
from surveilnav.perception.models import check, digest
from surveilnav.perception.models.catalogue import CATALOGUE, Model, model_called
from surveilnav.perception.models.pull import cache, pull
from surveilnav.perception.models.transfer import OnProgress

#: Larger models are fetched by `surveilnav models pull` alone: nobody expects gigabytes because a service starts.
MOST_UNASKED_BYTES = 100_000_000


@dataclass(frozen=True, slots=True)
class Seen:
    """What lies under a model's name. ``path``: None where nothing does; ``fault``: what is wrong with it, or empty."""

    path: Path | None = None
    fault: str = ""


def find(name: str, *, download: bool = True, on_progress: OnProgress | None = None) -> Path:
    """The file or folder of a model, checked.

    Args:
        name: of the catalogue; or a folder's name in SURVEILNAV_MODELS_DIR; or a folder's path (with a slash in it).
        download: whether it may be fetched if it isn't on this machine and has at most ``MOST_UNASKED_BYTES``.
        on_progress: is told of each file's bytes.

    Raises:
        PerceptionError: it can't be had, or what is there isn't it.
    """
    own = _own(name)
    if own is not None:
        return check.checked_own(own)
    model = model_called(name)
    path, small = _present(model), model.size_bytes <= MOST_UNASKED_BYTES
    if path is not None and not (download and small and _half_pulled(path, model)):
        return check.checked(path, model)
    if not (download and small and model.source):
        raise PerceptionError(_not_here(model, download))
    return pull(name, on_progress=on_progress)


def family(name: str) -> str:
    """Who reads a model: the catalogue's word, or of another folder the ``model_type`` of its config.json.

    Raises:
        PerceptionError: there is no such model, or its config.json says nothing.
    """
    own = _own(name)
    if own is None:
        return model_called(name).family
    check.there(own)
    return check.model_type(own) if own.is_dir() else check.family_of_file(own)


def model_id(name: str, path: Path) -> str:
    """``name@hash8``: which weights made an embedding, so that no two kinds are ever compared.

    Args:
        name: as given to ``find``; of a path, its last part counts.
        path: what ``find`` returned. The hash is of its weights' content, and remembered by path, size and time.

    Raises:
        PerceptionError: it can't be read.
    """
    files = check.weights_of(path) if path.is_dir() else [path]
    try:
        hashes = [digest.sha256(file) for file in files]
    except OSError as error:
        raise PerceptionError(f"the weights in {path} can't be read: {error.strerror}") from error
    if not hashes:
        raise PerceptionError(f"{path} has no weights: expected model.safetensors or pytorch_model.bin in it")
    whole = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    return f"{Path(name).name}@{whole[:8]}"


def is_here(name: str) -> bool:
    """Whether anything lies under a name of the catalogue, whatever it is. PerceptionError: there is no such model."""
    return _present(model_called(name)) is not None


def survey(name: str, *, anew: bool = False) -> Seen:
    """What is here of a model. Never downloads; what it finds wrong is in ``Seen.fault``.

    Args:
        name: as for ``find``.
        anew: hash all of it, whatever is remembered of an earlier look.

    Raises:
        PerceptionError: there is no model of that name.
    """
    own = _own(name)
    path = own if own is not None else _present(model_called(name))
    if path is None:
        return Seen()
    try:
        return Seen(check.checked_own(path) if own else check.checked(path, model_called(name), anew=anew))
    except PerceptionError as error:
        return Seen(path, str(error))


def _not_here(model: Model, download: bool) -> str:
    """That a model isn't on this machine, and how it gets there."""
    if model.built_in:
        return (
            f"the weights of {model.name} don't come with this version of SurveilNav; {model.setting} can name a file"
        )
    how = f"`surveilnav models pull {model.name}` fetches it." if model.source else model.note
    if download and model.source:
        mb, most_mb = model.size_bytes / 1e6, MOST_UNASKED_BYTES / 1e6
        how = f"It has {mb:,.0f} MB, and only models of up to {most_mb:.0f} MB are fetched unasked: {how}"
    return f"{model.path} isn't on this machine. {how}"


def _present(model: Model) -> Path | None:
    """Where something lies under a model's name, whatever it is; None: nowhere."""
    return next((path for path in _places(model) if path.exists() or path.is_symlink()), None)


def _places(model: Model) -> Iterator[Path]:
    """Where a model may lie, the first first."""
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
    yield cache() / model.path


def _half_pulled(path: Path, model: Model) -> bool:
    """Whether a pull into the cache broke off between two files."""
    return path.parent == cache() and model.is_folder and bool(list(check.missing_files(path, model)))


def _own(name: str) -> Path | None:
    """The file or folder that a path, or a folder's name in SURVEILNAV_MODELS_DIR, means; None: a model of the catalogue."""
    if "/" in name or "\\" in name:
        return Path(name).expanduser()
    given = models_dir()
    catalogued = name in CATALOGUE and CATALOGUE[name].is_folder
    if name and not catalogued and given is not None and (given / name).is_dir():
        return given / name
    return None
