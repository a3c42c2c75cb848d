"""Where ONNX Runtime runs a network, and with how many threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import onnxruntime
import pytest

from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.runtime import Runtime

CPU = "CPUExecutionProvider"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the session was opened with, where ONNX Runtime can use a GPU."""
    said: dict[str, Any] = {}

    def record(path: str, options: Any, providers: Any) -> None:
        said.update(threads=options.intra_op_num_threads, providers=providers)

    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", CPU])
    monkeypatch.setattr(onnxruntime, "InferenceSession", record)
    return said


@pytest.mark.parametrize(("device", "number"), [("auto", "0"), ("cuda", "0"), ("cuda:1", "1")])
def test_a_gpu_is_used_where_onnx_runtime_can(device: str, number: str, opened: dict[str, Any]) -> None:
    open_session(Path("a.onnx"), Runtime(device, threads=3))
    assert opened == {"threads": 3, "providers": [("CUDAExecutionProvider", {"device_id": number}), CPU]}


def test_who_asks_for_the_processor_gets_it(opened: dict[str, Any]) -> None:
    open_session(Path("a.onnx"), Runtime("cpu"))
    assert opened["providers"] == [CPU]


def test_without_a_gpu_of_its_own_onnx_runtime_runs_on_the_processor(
    opened: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: [CPU])
    open_session(Path("a.onnx"), Runtime("cuda"))
    assert opened["providers"] == [CPU]


@pytest.mark.parametrize(
    "program",
    [
        "import surveilnav.perception.detectors.onnx_file",
        "from surveilnav.services.planner.core.places.model import Places; Places()",
    ],
    ids=["detectors", "places"],
)
def test_onnx_runtime_does_not_report_its_use(tmp_path: Path, program: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("CI", "ORT_DISABLE_TELEMETRY")}
    subprocess.run(
        [sys.executable, "-c", program], check=True, env=environment | {"HOME": str(tmp_path), "TMPDIR": str(tmp_path)}
    )
    left = [
        path.name for path in tmp_path.rglob("*") if path.name in (".ses", "deviceid") or "onnxruntime" in path.name
    ]
    assert left == []  # ids and reports that it would keep until they are sent
