"""Opens networks in ONNX files with ONNX Runtime."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import onnxruntime

from surveilnav.errors import PerceptionError
from surveilnav.perception.runtime import Runtime

#: Lower scores are set to zero: over 80 classes and hundreds of boxes their noise would add up.
SCORE_FLOOR = 0.08


_CUDA, _CPU = "CUDAExecutionProvider", "CPUExecutionProvider"


def providers(device: str) -> list[Any]:
    """The execution providers for a ``Runtime``'s device, in order of preference: CUDA if ONNX Runtime supports it.

    The ordinary package doesn't, and runs on the CPU whatever is asked for; ``onnxruntime-gpu`` does.
    """
    kind, _, number = device.partition(":")
    if kind == "cpu" or _CUDA not in onnxruntime.get_available_providers():
        return [_CPU]
    return [(_CUDA, {"device_id": number or "0"}), _CPU]


def open_session(path: Path, runtime: Runtime) -> onnxruntime.InferenceSession:
    """Opens a file on the device and with the number of threads of ``runtime``; see ``providers``.

    Raises:
        PerceptionError: the file can't be loaded.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = runtime.threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads must not occupy a core
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers(runtime.device))
    except Exception as error:  # ONNX Runtime's exceptions share no public base class
        raise PerceptionError(f"{path.name} can't be loaded as an ONNX network: {error}") from error
