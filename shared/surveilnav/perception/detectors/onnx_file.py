"""Networks in ONNX files, under ONNX Runtime."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import onnxruntime

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime

#: Weaker scores than this are noise, which adds up over 80 classes and hundreds of boxes.
LOWEST = 0.08


_CUDA, _CPU = "CUDAExecutionProvider", "CPUExecutionProvider"


def providers(device: str) -> list[Any]:
    """What runs a network, the first first, on a ``Runtime``'s device: a GPU where this ONNX Runtime can use one.

    The ordinary package can't: it runs on the processor whatever is asked for. ``onnxruntime-gpu`` can.
    """
    kind, _, number = device.partition(":")
    if kind == "cpu" or _CUDA not in onnxruntime.get_available_providers():
        return [_CPU]
    return [(_CUDA, {"device_id": number or "0"}), _CPU]


def session(path: Path, runtime: Runtime) -> onnxruntime.InferenceSession:
    """A session on the device and with the threads that ``runtime`` says; see ``providers``.

    Raises:
        PerceptionError: the file can't be loaded.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = runtime.threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores to others
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers(runtime.device))
    except Exception as error:  # onnxruntime raises its own kinds, which share no public base
        raise PerceptionError(f"{path.name} can't be loaded as an ONNX network: {error}") from error
