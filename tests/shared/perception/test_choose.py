"""Which backend runs, and why."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from simulator.truth.choose import BACKENDS, choose_backend
from surveilnav.errors import PerceptionError
from surveilnav.perception.models import transfer
from surveilnav.perception.names import BackendName


@pytest.fixture
def bare_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No weights here, an empty cache."""
    for name in ("SURVEILNAV_MODELS_DIR", "SURVEILNAV_OFFLINE", "HF_HUB_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    return tmp_path


def no_network(*_: object, **__: object) -> None:
    raise httpx.ConnectError("Name or service not known")


def test_with_no_weights_and_no_network_auto_is_simulated_and_says_so(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transfer.httpx, "stream", no_network)
    backend = choose_backend("auto")
    assert backend.name == "simulated"
    assert "no real detector" in backend.why
    assert "SURVEILNAV_MODELS_DIR" in backend.why


def test_the_paper_names_the_command_that_fetches_a_large_model(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transfer.httpx, "stream", no_network)
    with pytest.raises(PerceptionError, match="`surveilnav models pull grounding-dino-tiny` fetches it"):
        choose_backend("paper")


def test_every_name_is_a_backend_s(bare_machine: Path) -> None:
    assert set(BACKENDS) == {str(name) for name in BackendName}


def test_asked_by_name_a_backend_runs_or_says_what_is_missing(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transfer.httpx, "stream", no_network)
    with pytest.raises(PerceptionError, match=r"yolox_nano.onnx.*SURVEILNAV_MODELS_DIR"):
        choose_backend("onnx-coco")
    assert choose_backend("oracle").name == "oracle"
    assert choose_backend("simulated").name == "simulated"
    with pytest.raises(PerceptionError, match="onnx-coco"):
        choose_backend("crystal-ball")
    with pytest.raises(PerceptionError, match="yolox-nano"):
        choose_backend("onnx-coco", detectors=["yolo-99"])
    with pytest.raises(PerceptionError, match="at least one"):
        choose_backend("onnx-coco", detectors=[])
