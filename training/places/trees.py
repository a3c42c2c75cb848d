"""Boosted trees of scikit-learn as an ONNX network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper
from sklearn.ensemble import HistGradientBoostingClassifier


def to_onnx(models: Sequence[HistGradientBoostingClassifier], n_inputs: int, about: Mapping[str, str]) -> bytes:
    """A network from ``features`` (n, n_inputs) float32 to ``chances`` (n, number of models), of binary classifiers.

    ``about``: what its metadata say.
    """
    trees: dict[str, Any] = {
        name: []
        for name in (
            "nodes_treeids",
            "nodes_nodeids",
            "nodes_featureids",
            "nodes_values",
            "nodes_modes",
            "nodes_truenodeids",
            "nodes_falsenodeids",
            "target_treeids",
            "target_nodeids",
            "target_ids",
            "target_weights",
        )
    }
    tree = 0
    for target, model in enumerate(models):
        for (predictor,) in model._predictors:
            for number, node in enumerate(predictor.nodes):
                leaf = bool(node["is_leaf"])
                trees["nodes_treeids"].append(tree)
                trees["nodes_nodeids"].append(number)
                trees["nodes_featureids"].append(0 if leaf else int(node["feature_idx"]))
                trees["nodes_values"].append(0.0 if leaf else _not_below(float(node["num_threshold"])))
                trees["nodes_modes"].append("LEAF" if leaf else "BRANCH_LEQ")
                trees["nodes_truenodeids"].append(0 if leaf else int(node["left"]))
                trees["nodes_falsenodeids"].append(0 if leaf else int(node["right"]))
                if leaf:
                    trees["target_treeids"].append(tree)
                    trees["target_nodeids"].append(number)
                    trees["target_ids"].append(target)
                    trees["target_weights"].append(float(node["value"]))
            tree += 1
    base = [float(np.ravel(m._baseline_prediction)[0]) for m in models]
    ensemble = helper.make_node(
        "TreeEnsembleRegressor",
        ["features"],
        ["logits"],
        domain="ai.onnx.ml",
        n_targets=len(models),
        base_values=base,
        aggregate_function="SUM",
        post_transform="NONE",
        **trees,
    )
    graph = helper.make_graph(
        [ensemble, helper.make_node("Sigmoid", ["logits"], ["chances"])],
        "places",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, [None, n_inputs])],
        [helper.make_tensor_value_info("chances", TensorProto.FLOAT, [None, len(models)])],
    )
    network = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17), helper.make_opsetid("ai.onnx.ml", 3)]
    )
    network.ir_version = 9
    for key, value in about.items():
        helper.set_model_props(network, {**{p.key: p.value for p in network.metadata_props}, key: value})
    onnx.checker.check_model(network)
    return bytes(network.SerializeToString())


def _not_below(threshold: float) -> float:
    """A threshold as float32, rounded up: inputs are float32, and one that equals it must still go left."""
    as_float = np.float32(threshold)
    return float(as_float if as_float >= threshold else np.nextafter(as_float, np.float32(np.inf)))
