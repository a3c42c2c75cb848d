"""Models of transformers: loaded from a folder, on a device, in halves of precision where a GPU has them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
import transformers.utils.logging
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime

transformers.utils.logging.disable_progress_bar()  # a service's log is no terminal


@dataclass(frozen=True, slots=True, eq=False)
class TorchModel:
    """A network in evaluation mode. ``net``: the transformers model; ``device``: where it runs."""

    net: Any
    device: torch.device

    def running(self) -> AbstractContextManager:
        """Inside it nothing is recorded for training; on a GPU matrices are multiplied in float16.

        Not bfloat16: its 8 bits would move a box by pixels.
        """
        stack = ExitStack()
        stack.enter_context(torch.inference_mode())
        if self.device.type == "cuda":
            stack.enter_context(torch.autocast("cuda", torch.float16))
        return stack

    def tensor(self, array: NDArray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)


def numbers(tensor: torch.Tensor) -> NDArray[np.float32]:
    """As float32 on the CPU."""
    return np.asarray(tensor.float().cpu().numpy(), np.float32)


def find_device(name: str) -> torch.device:
    """The device of a setting; "auto": a GPU if there is one. PerceptionError: there is no such device."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError, ValueError) as error:
        raise PerceptionError(
            f"expected a device out of auto, cpu, cuda, cuda:1, ...; {name!r} can't be used: {error}"
        ) from error
    return torch.device(name)


def load(kind: Any, path: Path, model_types: Sequence[str], runtime: Runtime) -> TorchModel:
    """The model in a folder, whole.

    Args:
        kind: its class in transformers.
        path: the folder, with config.json and weights.
        model_types: what its config.json may say it is.
        runtime: where and how it runs.

    Raises:
        PerceptionError: it isn't there, is another model, or lacks weights.
    """
    expect_type(path, model_types)
    torch.set_num_threads(runtime.threads)
    device = find_device(runtime.device)
    try:
        net, info = kind.from_pretrained(path, local_files_only=True, output_loading_info=True)
    except Exception as error:  # what transformers raises of a bad file has many classes
        raise PerceptionError(f"{path} can't be loaded as {kind.__name__}: {_first_line(error)}. {_AGAIN}") from error
    lacking = [str(key) for key in (*info["missing_keys"], *info["mismatched_keys"])]
    if lacking:
        raise PerceptionError(
            f"{path} lacks {len(lacking)} weights of {kind.__name__}, or has them in other shapes "
            f"({', '.join(sorted(lacking)[:3])}, ...). {_AGAIN}"
        )
    net = net.to(device).eval()
    if _compiles(runtime, device):
        _compile_entries(net)
    return TorchModel(net, device)


def _compiles(runtime: Runtime, device: torch.device) -> bool:
    return runtime.compiled and device.type == "cuda"


#: What detectors, segmenters and embedders call of a network; ``forward`` by calling the network itself.
_ENTRIES = ("forward", "get_image_embeddings", "get_image_features", "get_text_features")


def _compile_entries(net: Any) -> None:
    """Has PyTorch compile each entry of a network when it is first called.

    ``torch.compile(net)`` would compile ``forward`` alone: the other methods stay bound to the network as it was.
    """
    for name in _ENTRIES:
        if hasattr(net, name):
            setattr(net, name, torch.compile(getattr(net, name)))


def tokenizer(path: Path) -> Any:
    """The tokenizer of a folder. PerceptionError: it isn't there; transformers would make one that knows no word."""
    if not any((path / name).is_file() for name in _VOCABULARIES):
        raise PerceptionError(f"{path} has no tokenizer: expected one of {', '.join(_VOCABULARIES)} in it. {_AGAIN}")
    return _part(transformers.AutoTokenizer, path)


def image_processor(path: Path) -> Any:
    """The image processor of a folder, with Pillow: the same numbers whether torchvision is there or not.

    Raises:
        PerceptionError: it isn't there.
    """
    return _part(transformers.AutoImageProcessor, path, backend="pil")


def _part(kind: Any, path: Path, **options: Any) -> Any:
    try:
        return kind.from_pretrained(path, local_files_only=True, **options)
    except Exception as error:  # as above
        raise PerceptionError(
            f"{path} has no {kind.__name__[4:]} that can be read: {_first_line(error)}. {_AGAIN}"
        ) from error


def tokens(reader: Any, texts: Sequence[str], *, most: int = 77, whole: bool = False) -> dict[str, torch.Tensor]:
    """``input_ids`` and ``attention_mask`` (N, T) of texts, padded to the length that the model was trained with.

    Args:
        reader: a tokenizer.
        texts: N of them.
        most: tokens of a text, where the tokenizer has no smaller limit of its own.
        whole: a text that is too long is refused rather than cut.

    Raises:
        PerceptionError: such a text.
    """
    most = min(int(reader.model_max_length), most)
    for text in texts if whole else ():
        if (n := len(reader(text)["input_ids"])) > most:
            raise PerceptionError(f"{text[:40]!r} has {n} tokens, and this model reads {most}: shorten it")
    out = reader(list(texts), padding="max_length", truncation=True, max_length=most, return_tensors="pt")
    return {"input_ids": out["input_ids"], "attention_mask": out["attention_mask"]}


def expect_type(path: Path, model_types: Sequence[str]) -> str:
    """What a folder's config.json says it holds, which must be one of ``model_types``. PerceptionError: it isn't."""
    file = path / "config.json"
    try:
        found = json.loads(file.read_bytes()).get("model_type")
    except (OSError, ValueError, AttributeError) as error:
        raise PerceptionError(f"{file} can't be read as a model's configuration: {error}. {_AGAIN}") from error
    if found not in model_types:
        raise PerceptionError(f"expected a model of type {' or '.join(model_types)}, and {path} holds {found!r}")
    return str(found)


_VOCABULARIES = ("tokenizer.json", "vocab.json", "vocab.txt", "tokenizer.model", "spiece.model")
_AGAIN = "Fetch the folder anew, or name another"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200].rstrip(".")
