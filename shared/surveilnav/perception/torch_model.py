"""Loads models of the library transformers from folders, and runs them on a device; on a GPU in float16."""

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

transformers.utils.logging.disable_progress_bar()  # progress bars don't belong into a service's log


@dataclass(frozen=True, slots=True, eq=False)
class TorchModel:
    """A network in evaluation mode. ``net``: the model of transformers; ``device``: where it runs."""

    net: Any
    device: torch.device

    def running(self) -> AbstractContextManager:
        """The context in which to call ``net``: no gradients, and on a GPU matrix products in float16.

        Not in bfloat16, whose 8 bits of precision would shift boxes by pixels.
        """
        stack = ExitStack()
        stack.enter_context(torch.inference_mode())
        if self.device.type == "cuda":
            stack.enter_context(torch.autocast("cuda", torch.float16))
        return stack

    def tensor(self, array: NDArray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)


def to_numpy(tensor: torch.Tensor) -> NDArray[np.float32]:
    """The tensor as a float32 array."""
    return np.asarray(tensor.float().cpu().numpy(), np.float32)


def find_device(name: str) -> torch.device:
    """The device that a setting names; "auto": a GPU if there is one. Raises PerceptionError if there is no such device."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError, ValueError) as error:
        raise PerceptionError(
            f"expected a device out of auto, cpu, cuda, cuda:1, ...; {name!r} can't be used: {error}"
        ) from error
    return torch.device(name)


def load_model(kind: Any, path: Path, model_types: Sequence[str], runtime: Runtime) -> TorchModel:
    """Loads a model from a folder.

    Args:
        kind: its class in transformers.
        path: the folder, with config.json and weights.
        model_types: the model types that its config.json may state.

    Raises:
        PerceptionError: the folder is missing, contains another model, or lacks weights.
    """
    check_model_type(path, model_types)
    torch.set_num_threads(runtime.threads)
    device = find_device(runtime.device)
    try:
        net, info = kind.from_pretrained(path, local_files_only=True, output_loading_info=True)
    except Exception as error:  # transformers raises many kinds of errors for bad files
        raise PerceptionError(f"{path} can't be loaded as {kind.__name__}: {_first_line(error)}. {_AGAIN}") from error
    missing = [str(key) for key in (*info["missing_keys"], *info["mismatched_keys"])]
    if missing:
        raise PerceptionError(
            f"{path} lacks {len(missing)} weights of {kind.__name__}, or has them in other shapes "
            f"({', '.join(sorted(missing)[:3])}, ...). {_AGAIN}"
        )
    net = net.to(device).eval()
    if _compiles(runtime, device):
        _compile_entry_points(net)
    return TorchModel(net, device)


def _compiles(runtime: Runtime, device: torch.device) -> bool:
    return runtime.compiled and device.type == "cuda"


#: The methods of networks that detectors, segmenters and embedders call.
_ENTRY_POINTS = ("forward", "get_image_embeddings", "get_image_features", "get_text_features")


def _compile_entry_points(net: Any) -> None:
    """Has PyTorch compile each entry point of a network at its first call.

    ``torch.compile(net)`` would compile ``forward`` only, since the other methods stay bound to the original network.
    """
    for name in _ENTRY_POINTS:
        if hasattr(net, name):
            setattr(net, name, torch.compile(getattr(net, name)))


def load_tokenizer(path: Path) -> Any:
    """Loads the tokenizer of a folder. Raises PerceptionError if there is none; transformers would make an empty one."""
    if not any((path / name).is_file() for name in _VOCABULARIES):
        raise PerceptionError(f"{path} has no tokenizer: expected one of {', '.join(_VOCABULARIES)} in it. {_AGAIN}")
    return _load_component(transformers.AutoTokenizer, path)


def load_image_processor(path: Path) -> Any:
    """Loads the image processor of a folder. It uses Pillow, so that the results don't depend on torchvision.

    Raises:
        PerceptionError: there is none.
    """
    return _load_component(transformers.AutoImageProcessor, path, backend="pil")


def _load_component(kind: Any, path: Path, **options: Any) -> Any:
    try:
        return kind.from_pretrained(path, local_files_only=True, **options)
    except Exception as error:  # as in load_model
        raise PerceptionError(
            f"{path} has no {kind.__name__[4:]} that can be read: {_first_line(error)}. {_AGAIN}"
        ) from error


def tokenize(
    tokenizer: Any, texts: Sequence[str], *, max_tokens: int = 77, refuse_long: bool = False
) -> dict[str, torch.Tensor]:
    """``input_ids`` and ``attention_mask`` (N, T) of N texts, padded to the length that the model was trained with.

    Args:
        max_tokens: length of a text, unless the tokenizer has a lower limit.
        refuse_long: raises an error for texts that are too long; otherwise they are cut.

    Raises:
        PerceptionError: a text is too long.
    """
    max_tokens = min(int(tokenizer.model_max_length), max_tokens)
    for text in texts if refuse_long else ():
        if (n := len(tokenizer(text)["input_ids"])) > max_tokens:
            raise PerceptionError(f"{text[:40]!r} has {n} tokens, and this model reads {max_tokens}: shorten it")
    out = tokenizer(list(texts), padding="max_length", truncation=True, max_length=max_tokens, return_tensors="pt")
    return {"input_ids": out["input_ids"], "attention_mask": out["attention_mask"]}


def check_model_type(path: Path, model_types: Sequence[str]) -> str:
    """The model type in a folder's config.json. Raises PerceptionError if it isn't one of ``model_types``."""
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
