"""The models that SurveilNav knows by name: kinds, files, hashes, licences. The data are in ``catalogue.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from surveilnav.errors import PerceptionError

DATA = Path(__file__).parent / "catalogue.json"
#: The folder of the built-in models.
BUILT_IN = Path(__file__).parents[1] / "data"


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of a model.

    ``bytes`` and ``sha256`` are of its content; None: unknown until the first pull. ``optional``: the model runs without it.
    """

    name: str
    bytes: int | None = None
    sha256: str | None = None
    optional: bool = False


class Model(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An entry of the catalogue.

    Attributes:
        family: which loader it needs; of a transformers folder, the ``model_type`` in its config.json or a close relative.
        vocabulary: "coco": the 80 classes; "own": those in its file; "open": any text; "": it knows no classes.
        repo, revision: on the Hugging Face hub.
        url: of the one file, where it isn't on the hub.
        setting: the environment variable that names a custom file, for a model without a public address.
        built_in: it is in this package's data, in a folder of its name, with a card beside it (``card.py``).
        about_mb: its size in MB, where that of no file is known exactly.
        note: what a user should know.
        confirmed: which parts of this entry were seen on public pages; the others are unconfirmed.
    """

    name: str = ""
    kind: Literal["detector", "segmenter", "embedder", "depth"]
    family: str
    licence: str
    files: tuple[File, ...]
    vocabulary: Literal["coco", "own", "open", ""] = ""
    repo: str = ""
    revision: str = ""
    url: str = ""
    setting: str = ""
    built_in: bool = False
    about_mb: int = 0
    note: str = ""
    confirmed: str = ""

    @property
    def is_folder(self) -> bool:
        """Whether it is a folder as transformers writes it, rather than one file."""
        return any(file.name == "config.json" for file in self.files)

    @property
    def path(self) -> str:
        """Its file or folder within a folder of models."""
        return self.name if self.is_folder else self.files[0].name

    @property
    def built_in_path(self) -> Path:
        """Where its file is in this package, if it is ``built_in``."""
        return BUILT_IN / self.name / self.path

    @property
    def source(self) -> str:
        """Where it comes from: repository and revision, or URL; "" if it has no public address."""
        return f"{self.repo}@{self.revision}" if self.repo else self.url

    @property
    def size_bytes(self) -> int:
        """Its size in bytes: exact, or approximate, or 0 where it isn't known. Files without a known size aren't counted."""
        return sum(file.bytes or 0 for file in self.files) or self.about_mb * 1_000_000

    def address(self, file: File, revision: str, endpoint: str) -> str:
        """The URL of one file. ``endpoint``: the hub's; ``revision``: a branch or commit there."""
        return f"{endpoint}/{self.repo}/resolve/{revision}/{file.name}" if self.repo else self.url


def _read() -> dict[str, Model]:
    entries = msgspec.json.decode(DATA.read_bytes(), type=dict[str, Model])
    return {name: msgspec.structs.replace(model, name=name) for name, model in entries.items()}


CATALOGUE: dict[str, Model] = _read()

#: The closed-set detectors: what the backend ``onnx-coco`` can run.
COCO_DETECTORS: tuple[str, ...] = tuple(name for name, model in CATALOGUE.items() if model.vocabulary == "coco")


def model_called(name: str) -> Model:
    """The entry of that name. PerceptionError: there is none; the message lists them."""
    if name not in CATALOGUE:
        raise PerceptionError(
            f"expected a model out of {', '.join(sorted(CATALOGUE))}, or the path of a folder; got {name!r}"
        )
    return CATALOGUE[name]
