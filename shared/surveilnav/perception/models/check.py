"""Checks that what lies at a path is the model that it is taken for: complete, whole, readable, with the right hash."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.perception.models import hashes
from surveilnav.perception.models.card import card_of
from surveilnav.perception.models.catalogue import Model
from surveilnav.perception.runtime import Runtime

_WEIGHTS = ("*.safetensors", "pytorch_model*.bin", "*.onnx")
#: A folder with these is MobileSAM (docs/use/models.md).
_MOBILE_SAM = ("encoder.onnx", "decoder.onnx")
#: Which family a model of one file belongs to.
_FAMILY_OF_SUFFIX = {".onnx": "yolo-world", ".pt": "mobile-sam"}
_LARGEST_HEADER = 100_000_000  # bytes: of a safetensors file, by its specification
#: How PyTorch's files began before version 1.6: a pickled number. Such a file doesn't say how long it should be.
_OLD_TORCH: Final = bytes.fromhex("80028a0a6cfc9c46f9206aa850192e")


def checked(path: Path, model: Model, *, anew: bool = False) -> Path:
    """Checks that ``path`` is ``model``, and returns it.

    Args:
        anew: hash everything again, whatever hashes are remembered.

    Raises:
        PerceptionError: something is missing, cut off, unreadable, or has another hash.
    """
    expect_exists(path)
    if not model.is_folder:
        _expect_suffix(path, model)
        _expect_file(path, model, path.parent, anew)
        return path
    missing = list(missing_files(path, model))
    if missing:
        raise PerceptionError(
            f"{path} holds half of {model.name}: {', '.join(missing)} missing. "
            f"`surveilnav models pull {model.name}` fetches it into the cache; or copy the files there."
        )
    checked_folder(path)
    for file in model.files:
        if (path / file.name).exists():
            _expect_file(path / file.name, model, path.parent, anew)
    return path


def missing_files(folder: Path, model: Model) -> Iterator[str]:
    """The files that a model's folder lacks. Weights in another format than the catalogue's do as well."""
    have_weights = bool(weights_of(folder))
    for file in model.files:
        of_weights = any(Path(file.name).match(pattern) for pattern in _WEIGHTS)
        if not file.optional and not (folder / file.name).is_file() and not (of_weights and have_weights):
            yield file.name


def checked_custom(path: Path) -> Path:
    """Checks that ``path`` is a file or folder that can be loaded as a model, and returns it. PerceptionError: it isn't."""
    expect_exists(path)
    if path.is_dir():
        return checked_folder(path)
    family_of_file(path)
    expect_whole(path)
    expect_readable(path)
    return path


def family_of_file(path: Path) -> str:
    """The family that a model of one file belongs to, by its suffix. PerceptionError: to none."""
    if path.suffix not in _FAMILY_OF_SUFFIX:
        raise PerceptionError(
            f"expected a folder with config.json and weights, or a file {' or '.join(_FAMILY_OF_SUFFIX)}; {path} is neither"
        )
    return _FAMILY_OF_SUFFIX[path.suffix]


def checked_folder(folder: Path) -> Path:
    """Checks that ``folder`` is a model as transformers writes it, or MobileSAM, and returns it. PerceptionError: it isn't."""
    expect_exists(folder)
    model_type(folder)
    weights = weights_of(folder)
    if not weights:
        raise PerceptionError(f"{folder} has no weights: expected model.safetensors or pytorch_model.bin in it")
    for path in (*sorted(folder.glob("*.json")), *weights):
        expect_whole(path)
        expect_readable(path)
    return folder


def weights_of(folder: Path) -> list[Path]:
    """The files of weights that a loader would read: safetensors if there are any, else PyTorch's, else ONNX; sorted."""
    for pattern in _WEIGHTS:
        if found := sorted(folder.glob(pattern)):
            return found
    return []


def model_type(folder: Path) -> str:
    """The ``model_type`` in a folder's config.json, or "mobile-sam" by the names of its files. PerceptionError: there is none."""
    if all((folder / name).is_file() for name in _MOBILE_SAM):
        return "mobile-sam"
    path = folder / "config.json"
    expect_exists(path)
    try:
        said = msgspec.json.decode(path.read_bytes(), type=dict[str, Any]).get("model_type")
    except (OSError, msgspec.DecodeError) as error:
        raise PerceptionError(f"{path} should be a model's settings in JSON, but can't be read: {error}") from error
    if not isinstance(said, str) or not said:
        raise PerceptionError(f"{path} names no model_type: expected a folder that transformers' save_pretrained wrote")
    return said


def expect_exists(path: Path) -> None:
    """PerceptionError: nothing lies at ``path``, or it is a link that leads nowhere."""
    try:
        path.stat()
    except FileNotFoundError as error:
        if path.is_symlink():
            raise PerceptionError(
                f"{path} is a link that leads nowhere: remove it, or mend what it points to"
            ) from error
        raise PerceptionError(f"expected a model's file or folder at {path}, there is nothing") from error
    except OSError as error:  # a circle of links, no permission
        raise PerceptionError(f"{path} can't be reached ({error.strerror}): mend it, or remove it") from error


def _expect_suffix(path: Path, model: Model) -> None:
    """PerceptionError: a custom file is of another kind than the model's."""
    suffix = Path(model.path).suffix
    if path.suffix != suffix:
        raise PerceptionError(f"expected {model.name} as a file {suffix}, and {path} is none: name another")


def _expect_file(path: Path, model: Model, root: Path, anew: bool) -> None:
    """PerceptionError: a file isn't whole, or hasn't the hash that the catalogue or the lock in ``root`` says."""
    expect_exists(path)
    expect_whole(path)
    expected = hashes.expected_sha256(
        next((file for file in model.files if file.name == path.name), None), hashes.lock_entry(model, root)
    )
    if model.built_in and (card := card_of(path)) is not None:
        expected = card.sha256
    if expected is None:
        expect_readable(path)
        return
    try:
        found = hashes.sha256(path, anew=anew)
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error
    if found != expected:
        raise PerceptionError(
            f"{path} isn't what {model.name} should be: its sha256 begins {found[:12]}, not {expected[:12]}. "
            "Remove it, and it will be downloaded again. A model of your own goes by its folder's path instead."
        )


# --- formats of files ---------------------------------------------------------------------------------------------


def expect_whole(path: Path) -> None:
    """PerceptionError: a file is empty, cut off or invalid JSON, as far as its format allows to tell."""
    try:
        size = path.stat().st_size
        if size == 0:
            raise PerceptionError(f"{path} is empty: remove it, and pull or copy it again")
        if path.suffix == ".json":
            msgspec.json.decode(path.read_bytes())
        elif path.suffix == ".safetensors" and size != (should := _size_by_header(path)):
            raise PerceptionError(
                f"{path} isn't whole: {size:,} bytes are there, its beginning speaks of {should:,}. "
                "Remove it, and pull or copy it again."
            )
    except msgspec.DecodeError as error:
        raise PerceptionError(f"{path} is damaged ({error}): remove it, and pull or copy it again") from error
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error


def _size_by_header(path: Path) -> int:
    """How large a safetensors file should be, in bytes, by its header: a length, a table of tensors, their bytes."""
    with path.open("rb") as file:
        length = struct.unpack("<Q", file.read(8).ljust(8, b"\xff"))[0]
        if length > _LARGEST_HEADER:
            raise PerceptionError(f"{path} is no safetensors file: remove it, and pull or copy it again")
        table = msgspec.json.decode(file.read(length), type=dict[str, dict[str, Any]])
    ends = [int(tensor["data_offsets"][1]) for tensor in table.values() if "data_offsets" in tensor]
    return 8 + int(length) + max(ends, default=0)


def expect_readable(path: Path) -> None:
    """PerceptionError: an ONNX network can't be opened, or a file isn't PyTorch's or is cut off.

    This is for files whose hash isn't known: opening a network takes time.
    """
    if path.suffix == ".onnx":
        from surveilnav.perception.detectors.onnx_file import (
            open_session,  # who only lists models needs no ONNX Runtime
        )

        open_session(path, Runtime("cpu"))
    elif path.suffix in (".pt", ".bin"):
        _expect_torch(path)


def _expect_torch(path: Path) -> None:
    """PerceptionError: a file isn't as PyTorch saves it: a zip archive, whose table stands at its end."""
    try:
        with path.open("rb") as file:
            begins_as = file.read(len(_OLD_TORCH))
        is_torch = begins_as == _OLD_TORCH or (begins_as.startswith(b"PK") and zipfile.is_zipfile(path))
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error
    if not is_torch:
        raise PerceptionError(f"{path} isn't what PyTorch saves, or isn't whole: remove it, and pull or copy it again")
