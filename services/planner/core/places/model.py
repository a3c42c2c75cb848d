"""The model of ``places``: for each frontier, how far beyond it the nearest instance of the target may lie."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.planner.core.goals.frontiers import Frontier
from surveilnav.services.planner.core.inputs import FloorMaps
from surveilnav.services.planner.core.places.features import FrontierFeatures, of_target

FILE = Path(__file__).with_name("places.onnx")


class Places:
    """A trained model.

    Attributes:
        within_m: (k,) ascending distances [m] for which it says how likely the target is nearer.
        targets: the classes that it learned to expect; ``labels``: the classes of objects that it looks at.
    """

    def __init__(self, path: Path = FILE) -> None:
        import onnxruntime  # takes 20 MB, which a planner that doesn't use the model needn't have

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        about: dict[str, Any] = json.loads(self._session.get_modelmeta().custom_metadata_map["places"])
        self.within_m = np.array(about["within_m"])
        self.targets: tuple[str, ...] = tuple(about["targets"])
        self.labels: tuple[str, ...] = tuple(about["labels"])

    def chances(
        self, maps: FloorMaps, robot_xy_m: tuple[float, float], frontiers: Sequence[Frontier], target: str
    ) -> NDArray[np.float64]:
        """(n, k) the chances that the nearest instance of ``target`` lies within ``within_m`` of way beyond each of n frontiers.

        A target that the model doesn't know is expected wherever anything is: the mean over all that it knows.
        """
        if not frontiers:
            return np.zeros((0, len(self.within_m)))
        features = FrontierFeatures(maps, robot_xy_m, self.labels).of(frontiers)
        of = [target] if target in self.targets else list(self.targets)
        inputs = [of_target(features, self.labels, self.targets, t, best_chance(maps, t)) for t in of]
        chances = self._session.run(None, {"features": np.concatenate(inputs)})[0]
        mean = chances.reshape(len(of), len(frontiers), -1).mean(axis=0, dtype=np.float64)
        return np.asarray(np.maximum.accumulate(mean, axis=1))


def best_chance(maps: FloorMaps, target: str) -> float:
    """The chance of the likeliest object of a floor to be ``target``."""
    return max((o.label_scores.get(target, 0.0) for o in maps.objects if o.status != "rejected"), default=0.0)


@lru_cache(maxsize=1)
def shipped() -> Places:
    """The model that comes with the planner."""
    return Places()
