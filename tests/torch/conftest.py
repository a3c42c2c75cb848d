"""Tests of the networks under PyTorch. ``make test`` skips them; ``make test-torch`` runs them."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

_HERE = all(find_spec(name) for name in ("torch", "transformers", "onnx"))


class _Skipped(pytest.Module):
    """A file whose imports can't be had."""

    def collect(self) -> list[Any]:
        pytest.skip("needs PyTorch: make test-torch", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: Any) -> pytest.Module | None:
    return None if _HERE else _Skipped.from_parent(parent, path=module_path)


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """Tiny networks gain nothing from a second thread, and lose much where others use the cores."""
    import torch

    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def folder_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """``folder_of("clip")``: a folder with the tiny model of that name (``tiny``), made once. Tests must only read it."""
    from tests.torch import tiny

    made: dict[tuple[Any, ...], Path] = {}

    def folder(name: str, **more: Any) -> Path:
        key = (name, *sorted(more.items()))
        if key not in made:
            made[key] = getattr(tiny, name)(tmp_path_factory.mktemp(name), **more)
        return made[key]

    return folder


@pytest.fixture(scope="session")
def pictures() -> list[NDArray[np.uint8]]:
    """Eight of 160 x 120 pixels: colours that change slowly, and noise."""
    rng, out = np.random.default_rng(5), []
    for _ in range(8):
        coarse = rng.integers(0, 255, (4, 5, 3)).repeat(30, axis=0).repeat(32, axis=1)
        out.append(np.clip(coarse + rng.integers(-20, 20, (120, 160, 3)), 0, 255).astype(np.uint8))
    return out
