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


#: Two words that the tiny models learn, one of two tokens, and what the rooms are asked about.
WORDS = ("couch", "dining table")
ROOM_TEXTS = {"Living room": "seems like there is a couch", "Kitchen": "seems like there is a dining table"}


@pytest.fixture(scope="session")
def home() -> Any:
    """A small home of boxes: (renderer, navigation)."""
    from surveilnav.simulator.render.renderer import Renderer
    from surveilnav.simulator.sources import open_building
    from surveilnav.simulator.world.navigation import NavigationMap

    scene = open_building("parametric_flat")
    return Renderer(scene, lighting="flat"), NavigationMap.build(scene)


@pytest.fixture(scope="session")
def twenty(home: Any) -> Any:
    """Twenty renders of the home as its robot sees it, each of which shows one of ``WORDS`` at least."""
    from surveilnav.robot_body import CAMERA
    from tests.torch.trained import examples

    return examples(*home, CAMERA, WORDS, 20)


@pytest.fixture(scope="session")
def tiny_grounding_dino(twenty: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tiny Grounding DINO that knows where ``WORDS`` are in ``twenty``. Two minutes."""
    from tests.torch.trained import train_grounding_dino

    return train_grounding_dino(tmp_path_factory.mktemp("trained") / "tiny-grounding-dino", twenty, WORDS)


@pytest.fixture(scope="session")
def tiny_clip(home: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tiny CLIP that tells the living room from the kitchen by ``ROOM_TEXTS``."""
    from surveilnav.robot_body import CAMERA
    from tests.torch.trained import room_views, train_clip

    shown = [(rgb, text) for room, text in ROOM_TEXTS.items() for rgb in room_views(*home, CAMERA, room, 120)]
    return train_clip(tmp_path_factory.mktemp("trained") / "tiny-clip", shown)


@pytest.fixture(scope="session")
def tiny_home_detector(home: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same for the whole home: it has seen ``WORDS`` from many places, and views without them. Minutes."""
    from surveilnav.robot_body import CAMERA
    from tests.torch.trained import examples, train_grounding_dino

    shown = examples(*home, CAMERA, WORDS, 160, empty=60)
    return train_grounding_dino(tmp_path_factory.mktemp("trained") / "home-grounding-dino", shown, WORDS, steps=500)
