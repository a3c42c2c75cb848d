"""``models.lock.json``: hashes that the first pull met, beside the models. Later content is held to them."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.perception.models.catalogue import File, Model
from surveilnav.storage import atomic_write
from surveilnav.storage import file_lock as held

NAME = "models.lock.json"


class Locked(msgspec.Struct, frozen=True):
    """What was pulled of one model. ``revision``: the hub's commit; ``sha256``: by file."""

    source: str
    revision: str = ""
    sha256: dict[str, str] = {}


def read(folder: Path) -> dict[str, Locked]:
    """The lock of a folder of models; empty where there is none. PerceptionError: it is damaged."""
    path = folder / NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Locked])
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.DecodeError) as error:
        raise PerceptionError(
            f"{path} should hold the hashes of pulled models, but can't be read ({error}). "
            "Remove it: the next pull trusts what it meets, and writes it anew."
        ) from error


def of(model: Model, folder: Path) -> Locked:
    """What was pulled of a model from its present source; an empty lock where that is nothing."""
    locked = read(folder).get(model.name)
    return locked if locked is not None and locked.source == model.source else Locked(model.source)


def write(model: Model, folder: Path, locked: Locked) -> None:
    """Puts a model's hashes into the lock of a folder. OSError: as the disk does.

    The file is all models', and several may be pulled at once: nobody reads between another's reading and writing.
    """
    with held(folder / f".{NAME}.held"), atomic_write(folder / NAME) as file:
        file.write(msgspec.json.format(msgspec.json.encode(read(folder) | {model.name: locked}), indent=2))


def expected(file: File | None, locked: Locked) -> str | None:
    """The sha256 that a file must have: the catalogue's, else the first pull's; None: nobody knows."""
    return (file.sha256 or locked.sha256.get(file.name)) if file is not None else None
