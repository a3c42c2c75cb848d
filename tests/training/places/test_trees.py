"""Boosted trees as ONNX say what scikit-learn's say."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier

from training.places.trees import to_onnx


def test_the_network_says_what_the_trees_say():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(2000, 5)).round(1).astype(np.float32)  # rounded: many values equal thresholds
    models = [
        HistGradientBoostingClassifier(max_iter=20, random_state=0).fit(x, x[:, 0] + x[:, k] > 0.3 * k) for k in (1, 2)
    ]
    session = onnxruntime.InferenceSession(to_onnx(models, 5, {"places": "{}"}), providers=["CPUExecutionProvider"])
    expected = np.stack([m.predict_proba(x)[:, 1] for m in models], axis=1)
    assert session.run(None, {"features": x})[0] == pytest.approx(expected, abs=1e-5)
    assert session.get_modelmeta().custom_metadata_map == {"places": "{}"}
