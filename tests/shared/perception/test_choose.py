"""Which backend runs, and why."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.perception import choose
from surveilnav.perception.models import transfer
from surveilnav.perception.names import BackendName
from surveilnav.simulator.truth.backends import Simulated
from surveilnav.simulator.truth.choose import BACKENDS, choose_backend
from tests.compact_file import write


@pytest.fixture
def bare_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No weights here, nor in the package; an empty cache."""
    for name in ("SURVEILNAV_MODELS_DIR", "SURVEILNAV_OFFLINE", "HF_HUB_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("SURVEILNAV_COMPACT", raising=False)
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(transfer.httpx, "stream", no_network)
    monkeypatch.setattr("surveilnav.perception.models.catalogue.BUILT_IN", tmp_path / "built-in")
    return tmp_path


@pytest.fixture
def compact(bare_machine: Path) -> Path:
    """Weights of ``compact`` in the package's data, and nothing else."""
    return write(bare_machine / "built-in" / "compact" / "compact.onnx")


def no_network(*_: object, **__: object) -> None:
    raise httpx.ConnectError("Name or service not known")


def test_with_no_weights_and_no_network_auto_is_simulated_and_says_so(bare_machine: Path) -> None:
    backend = choose_backend("auto")
    assert backend.name == "simulated"
    assert "no real detector" in backend.why
    assert "SURVEILNAV_MODELS_DIR" in backend.why
    assert "compact" not in backend.why


def test_without_a_network_auto_is_the_one_that_the_package_has(compact: Path) -> None:
    backend = choose_backend("auto", simulated=False)
    assert backend.name == "compact"
    assert "the best that runs here; onnx-coco can't run" in backend.why
    assert backend.models.detector.startswith("compact@")


@pytest.mark.parametrize(
    ("simulated", "best", "why"),
    [(True, "compact", "for a simulated building"), (False, "simulated", "the best that runs here")],
)
def test_auto_is_what_learnt_from_such_buildings(
    compact: Path, monkeypatch: pytest.MonkeyPatch, simulated: bool, best: str, why: str
) -> None:
    """The fake named simulated is in the place of onnx-coco."""
    monkeypatch.setattr(choose, "PRESETS", {**choose.PRESETS, "onnx-coco": lambda networks, why: Simulated(why)})
    backend = choose_backend("auto", simulated=simulated)
    assert backend.name == best
    assert why in backend.why
    assert "can't run" not in backend.why


def test_weights_that_are_damaged_are_named_and_the_next_best_runs(
    compact: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compact.write_bytes(b"damaged")
    backend = choose_backend("auto")
    assert backend.name == "simulated"
    assert "compact can't run" in backend.why
    assert "onnx-coco can't run" in backend.why
    monkeypatch.setattr(choose, "PRESETS", {**choose.PRESETS, "onnx-coco": lambda networks, why: Simulated(why)})
    assert choose_backend("auto", simulated=False).why == "the best that runs here"


def test_without_its_weights_compact_says_so(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PerceptionError, match="SURVEILNAV_COMPACT can name a file"):
        choose_backend("compact")
    monkeypatch.setenv("SURVEILNAV_COMPACT", str(write(bare_machine / "mine.onnx")))
    assert choose_backend("compact").name == "compact"


@pytest.mark.parametrize("name", ["auto", "compact"])
def test_a_library_without_a_simulator_has_no_stand_in(bare_machine: Path, name: str) -> None:
    with pytest.raises(PerceptionError, match=r"onnx-coco|compact"):
        choose.choose_backend(name)


def test_the_paper_names_the_command_that_fetches_a_large_model(bare_machine: Path) -> None:
    with pytest.raises(PerceptionError, match="`surveilnav models pull grounding-dino-tiny` fetches it"):
        choose_backend("paper")


def test_every_name_is_a_backend_s(bare_machine: Path) -> None:
    assert set(BACKENDS) == {str(name) for name in BackendName}


def test_asked_by_name_a_backend_runs_or_says_what_is_missing(bare_machine: Path) -> None:
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
