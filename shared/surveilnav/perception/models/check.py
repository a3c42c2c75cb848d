"""Whether what lies in a folder is the model that it is called: whole, readable, with the hash that it should have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.perception.models import digest, lock
from surveilnav.perception.models.card import card_of
from surveilnav.perception.models.catalogue import Model
from surveilnav.perception.models.formats import readable, whole

_WEIGHTS = ("*.safetensors", "pytorch_model*.bin", "*.onnx")
#: A folder with these is MobileSAM (docs/use/models.md).
_MOBILE_SAM = ("encoder.onnx", "decoder.onnx")
#: Whose a single file is.
_FAMILY_OF_SUFFIX = {".onnx": "yolo-world", ".pt": "mobile-sam"}


def checked(path: Path, model: Model, *, anew: bool = False) -> Path:
    """``path``, once it is seen to be ``model``.

    Args:
        path: its file or folder.
        anew: hash everything, whatever is remembered of an earlier look.

    Raises:
        PerceptionError: something is missing, cut off, unreadable, or has another hash.
    """
    there(path)
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


def checked_own(path: Path) -> Path:
    """``path``, once it is seen to be a file or folder that somebody reads. PerceptionError: it isn't."""
    there(path)
    if path.is_dir():
        return checked_folder(path)
    family_of_file(path)
    whole(path)
    readable(path)
    return path


def family_of_file(path: Path) -> str:
    """Whose a single file is. PerceptionError: nobody's."""
    if path.suffix not in _FAMILY_OF_SUFFIX:
        raise PerceptionError(
            f"expected a folder with config.json and weights, or a file {' or '.join(_FAMILY_OF_SUFFIX)}; {path} is neither"
        )
    return _FAMILY_OF_SUFFIX[path.suffix]


def checked_folder(folder: Path) -> Path:
    """``folder``, once it is seen to be a model as transformers writes it, or MobileSAM. PerceptionError: it isn't."""
    there(folder)
    model_type(folder)
    weights = weights_of(folder)
    if not weights:
        raise PerceptionError(f"{folder} has no weights: expected model.safetensors or pytorch_model.bin in it")
    for path in (*sorted(folder.glob("*.json")), *weights):
        whole(path)
        readable(path)
    return folder


def weights_of(folder: Path) -> list[Path]:
    """The files of weights that a loader would read: safetensors if there are any, else PyTorch's, in order."""
    for pattern in _WEIGHTS:
        if found := sorted(folder.glob(pattern)):
            return found
    return []


def model_type(folder: Path) -> str:
    """The ``model_type`` that a folder's config.json says, or whose it is by its files. PerceptionError: it says none."""
    if all((folder / name).is_file() for name in _MOBILE_SAM):
        return "mobile-sam"
    path = folder / "config.json"
    there(path)
    try:
        said = msgspec.json.decode(path.read_bytes(), type=dict[str, Any]).get("model_type")
    except (OSError, msgspec.DecodeError) as error:
        raise PerceptionError(f"{path} should be a model's settings in JSON, but can't be read: {error}") from error
    if not isinstance(said, str) or not said:
        raise PerceptionError(f"{path} names no model_type: expected a folder that transformers' save_pretrained wrote")
    return said


def there(path: Path) -> None:
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
    there(path)
    whole(path)
    expected = lock.expected(next((file for file in model.files if file.name == path.name), None), lock.of(model, root))
    if model.built_in and (card := card_of(path)) is not None:
        expected = card.sha256
    if expected is None:
        readable(path)
        return
    try:
        found = digest.sha256(path, anew=anew)
    except OSError as error:
        raise PerceptionError(f"{path} can't be read: {error.strerror}") from error
    if found != expected:
        raise PerceptionError(
            f"{path} isn't what {model.name} should be: its sha256 begins {found[:12]}, not {expected[:12]}. "
            "Remove it, and it will be downloaded again. A model of your own goes by its folder's path instead."
        )
