"""Fetches a model of the catalogue into the cache, file by file."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surveilnav.config import cache_dir, hub_endpoint, offline
from surveilnav.errors import PerceptionError
from surveilnav.perception.models import check, hashes
from surveilnav.perception.models.catalogue import File, Model, model_called
from surveilnav.perception.models.transfer import Download, OnProgress, transfer
from surveilnav.storage import file_lock


def pull_folder() -> Path:
    """The folder that models are pulled into if no other is named: in the cache."""
    return cache_dir() / "models"


def pull(name: str, *, to: Path | None = None, on_progress: OnProgress | None = None) -> Path:
    """Fetches what is missing of a model, checks it, and returns its file or folder.

    Args:
        name: of the catalogue.
        to: a folder of models to pull into; the cache if None.

    Raises:
        PerceptionError: offline, no such model, no public address, or what is received isn't the model.
    """
    model, folder = model_called(name), to or pull_folder()
    path = folder / model.path
    if not model.source:
        raise PerceptionError(f"{name} has no public address. {model.note}")
    if path.exists() and not (model.is_folder and list(check.missing_files(path, model))):
        return check.checked(path, model)
    if offline():
        raise PerceptionError(
            f"{name} isn't in {folder}, and nothing is downloaded: SURVEILNAV_OFFLINE or HF_HUB_OFFLINE is set. "
            f"Pull it on a machine with a network, and point SURVEILNAV_MODELS_DIR at a folder with {model.path} in it."
        )
    try:
        with file_lock(folder / f".{name}.lock"):  # another process may want the same
            _fetch(model, folder, on_progress)
    except OSError as error:
        raise PerceptionError(
            f"{name} can't be pulled into {folder} ({error.strerror}). Set SURVEILNAV_CACHE_DIR to a folder you can "
            "write, or point SURVEILNAV_MODELS_DIR at a folder that has the model."
        ) from error
    return check.checked(path, model)


def _fetch(model: Model, folder: Path, on_progress: OnProgress | None) -> None:
    """Downloads the files that aren't there. The hash of each goes into the lock file at once."""
    for file in model.files:
        path = folder / model.path / file.name if model.is_folder else folder / file.name
        if path.is_file():
            continue
        entry = hashes.lock_entry(model, folder)
        revision = entry.revision or model.revision  # all files of one commit
        address = model.address(file, revision, hub_endpoint())
        download = Download(address, path, file.bytes, hashes.expected_sha256(file, entry))
        try:
            sha256, remote = transfer(download, on_progress)
        except FileNotFoundError as error:
            _expect_optional(model, file, error)
            continue
        entry = msgspec.structs.replace(
            entry, revision=entry.revision or remote.commit, sha256=entry.sha256 | {file.name: sha256}
        )
        hashes.write_lock_entry(model, folder, entry)


def _expect_optional(model: Model, file: File, error: FileNotFoundError) -> None:
    """PerceptionError: the source lacks a file that the model needs."""
    if not file.optional:
        raise PerceptionError(
            f"{error.filename} doesn't exist (404), but {model.name} needs {file.name}. Its source has changed, or "
            "HF_ENDPOINT names a server without it. Get it elsewhere, and name its folder by SURVEILNAV_MODELS_DIR."
        ) from error
