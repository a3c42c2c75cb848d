"""Which backend runs, and why; weights that are missing, broken, or someone else's."""

from __future__ import annotations

import hashlib
from pathlib import Path

import httpx
import pytest

from simulator.truth.choose import choose_backend
from surveilnav.errors import PerceptionError
from surveilnav.perception import weights


@pytest.fixture
def bare_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No weights here, an empty cache."""
    monkeypatch.delenv("SURVEILNAV_MODELS_DIR", raising=False)
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    return tmp_path


def no_network(*_: object, **__: object) -> None:
    raise httpx.ConnectError("Name or service not known")


def test_with_no_weights_and_no_network_auto_is_simulated_and_says_so(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights.httpx, "stream", no_network)
    backend = choose_backend("auto")
    assert backend.name == "simulated"
    assert "no real detector" in backend.why
    assert "SURVEILNAV_MODELS_DIR" in backend.why


def test_asked_by_name_a_backend_runs_or_says_what_is_missing(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights.httpx, "stream", no_network)
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


class Served:
    """What httpx.stream gives, from bytes."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def __enter__(self) -> Served:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def raise_for_status(self) -> None:
        pass

    def iter_bytes(self):  # type: ignore[no-untyped-def]
        yield from (self._data[i : i + 1000] for i in range(0, len(self._data), 1000))


def test_a_download_is_checked_kept_and_used_again(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytes(range(256)) * 20
    fake = weights.Weights(
        "fake", "yolox", "fake.onnx", len(data), hashlib.sha256(data).hexdigest(), "https://x/y", "none"
    )
    monkeypatch.setitem(weights.WEIGHTS, "fake", fake)
    asked = []
    monkeypatch.setattr(weights.httpx, "stream", lambda *a, **k: asked.append(a) or Served(data))
    assert weights.find("fake").read_bytes() == data
    assert weights.find("fake").read_bytes() == data
    assert len(asked) == 1


@pytest.mark.parametrize("served", [b"x" * 5120, b"x" * 100, b"x" * 100_000])
def test_another_file_than_expected_is_not_used(
    served: bytes, bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = bytes(range(256)) * 20
    fake = weights.Weights(
        "fake", "yolox", "fake.onnx", len(data), hashlib.sha256(data).hexdigest(), "https://x/y", "none"
    )
    monkeypatch.setitem(weights.WEIGHTS, "fake", fake)
    monkeypatch.setattr(weights.httpx, "stream", lambda *a, **k: Served(served))
    with pytest.raises(PerceptionError, match="another file"):
        weights.find("fake")
    assert list((bare_machine / "models").iterdir()) == []


def test_a_wrong_file_on_disk_is_refused(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (bare_machine / "yolox_nano.onnx").write_bytes(b"not a network")
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(bare_machine))
    with pytest.raises(PerceptionError, match="sha256"):
        weights.find("yolox-nano")


def test_every_address_and_hash_is_whole() -> None:
    for w in weights.WEIGHTS.values():
        assert len(w.sha256) == 64
        assert w.url.startswith("https://")
        assert w.url.endswith(w.file)
        assert w.license.startswith("Apache-2.0")
