"""Networks in ONNX files, under ONNX Runtime."""

from __future__ import annotations

from pathlib import Path

import onnxruntime

from surveilnav.errors import PerceptionError

#: Weaker scores than this are noise, which adds up over 80 classes and hundreds of boxes.
LOWEST = 0.08


def session(path: Path, threads: int) -> onnxruntime.InferenceSession:
    """A session on the processor with so many threads.

    Raises:
        PerceptionError: the file can't be loaded.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores to others
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises its own kinds, which share no public base
        raise PerceptionError(f"{path.name} can't be loaded as an ONNX network: {error}") from error
