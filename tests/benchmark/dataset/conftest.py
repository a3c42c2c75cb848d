"""A dataset of two small buildings that need no assets."""

from __future__ import annotations

import pytest

from benchmark.dataset.make import make
from benchmark.dataset.splits import SceneSpec, SplitSpec

SPLIT = SplitSpec(
    "val_mini", (SceneSpec("parametric_flat", 0, "all"), SceneSpec("parametric_house", 1, "all")), 9, (3, 3)
)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("dataset")
    make(root, [SPLIT], workers=1)
    return root
