"""A tiny file of the kind that ``compact`` is: red is a tv, green a bed, at any depth. Made without PyTorch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from onnx import ModelProto, TensorProto, helper, numpy_helper

from surveilnav.perception.detectors.depth_channels import N_CHANNELS

CLASSES = ("tv", "bed", "chest of drawers", "table", "oven")
ROOMS = ("bedroom", "kitchen")
DIM = 8


def write(path: Path, *, blackness: float = -6.0, more: Mapping[str, Any] | None = None) -> Path:
    """Writes the file.

    Args:
        blackness: log-odds of what is black to be a chest of drawers; brighter things are less likely ones.
        more: metadata in the place of its own; None as a value leaves an entry out.
    """
    vectors = np.eye(DIM)
    near = vectors[[*range(len(CLASSES)), 1, 4]]  # a bedroom is where a bed is, a kitchen where an oven is
    said = {
        "classes": list(CLASSES),
        "rooms": list(ROOMS),
        "meanings": {"chest": "chest of drawers"},
        "class_vectors": vectors[: len(CLASSES)].tolist(),
        "near_vectors": near.tolist(),
    } | dict(more or {})
    model = _network(len(CLASSES), len(CLASSES) + len(ROOMS), blackness)
    for key, value in said.items():
        if value is not None:
            entry = model.metadata_props.add()
            entry.key, entry.value = key, json.dumps(value)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString())
    return path


def _network(n_classes: int, n_near: int, blackness: float) -> ModelProto:
    node, weights = helper.make_node, {}
    redness = np.zeros((3, n_classes), np.float32)
    redness[:, 0], redness[:, 1] = (12, -12, -12), (-12, 12, -12)
    redness[:, 2] = -2
    weights["to_scores"], weights["no_score"] = redness, np.array([-6, -6, blackness, -6, -6], np.float32)
    weights["to_ltrb"], weights["sixteen"] = np.zeros((3, 4), np.float32), np.full(4, 16, np.float32)
    weights["to_one"], weights["one"] = np.zeros((3, 1), np.float32), np.ones(1, np.float32)
    weights["to_vector"] = np.eye(3, DIM, dtype=np.float32)
    weights["a_bit"] = np.full(DIM, 1e-3, np.float32)
    weights["to_prototype"] = np.array([1, -1, -1], np.float32).reshape(1, 3, 1, 1)
    weights["to_near"] = np.zeros((3, n_near), np.float32)
    weights["rows"], weights["first"] = np.array([-1, 3], np.int64), np.array([0], np.int64)
    weights["whole"] = np.array(255, np.float32)
    nodes = [
        node("Cast", ["picture"], ["float"], to=TensorProto.FLOAT),
        node("Div", ["float", "whole"], ["share"]),
        node("Transpose", ["share"], ["nchw"], perm=[0, 3, 1, 2]),
    ]
    for stride in (8, 16, 32):
        size = {"kernel_shape": [stride, stride], "strides": [stride, stride]}
        nodes += [
            node("AveragePool", ["nchw"], [f"pool{stride}"], **size),
            node("Transpose", [f"pool{stride}"], [f"nhwc{stride}"], perm=[0, 2, 3, 1]),
            node("Reshape", [f"nhwc{stride}", "rows"], [f"cells{stride}"]),
        ]
    nodes += [
        node("Concat", ["cells8", "cells16", "cells32"], ["cells"], axis=0),
        node("MatMul", ["cells", "to_scores"], ["weighed"]),
        node("Add", ["weighed", "no_score"], ["logits"]),
        node("Sigmoid", ["logits"], ["scores"]),
        node("MatMul", ["cells", "to_ltrb"], ["zeros"]),
        node("Add", ["zeros", "sixteen"], ["ltrb"]),
        node("MatMul", ["cells", "to_one"], ["zero"]),
        node("Add", ["zero", "one"], ["coefficients"]),
        node("MatMul", ["cells", "to_vector"], ["vectors"]),
        node("Add", ["vectors", "a_bit"], ["some"]),
        node("LpNormalization", ["some"], ["embeddings"], axis=1, p=2),
        node("AveragePool", ["nchw"], ["quarter"], kernel_shape=[4, 4], strides=[4, 4]),
        node("Conv", ["quarter", "to_prototype"], ["masks"]),
        node("Squeeze", ["masks", "first"], ["prototypes"]),
        node("ReduceMean", ["embeddings"], ["mean"], axes=[0], keepdims=0),
        node("LpNormalization", ["mean"], ["image"], axis=0, p=2),
        node("ReduceMean", ["cells"], ["colour"], axes=[0], keepdims=0),
        node("MatMul", ["colour", "to_near"], ["nearness"]),
        node("Sigmoid", ["nearness"], ["near"]),
    ]
    outputs = ("scores", "ltrb", "coefficients", "embeddings", "prototypes", "image", "near")
    graph = helper.make_graph(
        nodes,
        "colours",
        [
            helper.make_tensor_value_info("picture", TensorProto.UINT8, [1, "height", "width", 3]),
            helper.make_tensor_value_info("depth", TensorProto.FLOAT, [1, "rows", "columns", N_CHANNELS]),
        ],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs],
        [numpy_helper.from_array(array, name) for name, array in weights.items()],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
