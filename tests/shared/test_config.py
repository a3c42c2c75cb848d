from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.config import cache_dir, hub_endpoint, models_dir, offline, path_from_env
from surveilnav.errors import ConfigError


def test_the_cache_lies_where_the_variable_says_and_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path / "a" / "b"))
    assert cache_dir() == tmp_path / "a" / "b"
    assert cache_dir().is_dir()


def test_the_cache_lies_in_the_home_directory_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", " ")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_dir() == tmp_path / ".cache" / "surveilnav"


def test_a_cache_that_cannot_be_made_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(ConfigError, match="SURVEILNAV_CACHE_DIR"):
        cache_dir()


def test_models_are_optional_and_must_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SURVEILNAV_MODELS_DIR", raising=False)
    assert models_dir() is None
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    assert models_dir() == tmp_path
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path / "no"))
    with pytest.raises(ConfigError, match="SURVEILNAV_MODELS_DIR"):
        models_dir()


def test_offline_is_said_by_either_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    for ours, the_hubs, said in (("", "", False), ("0", "no", False), ("1", "0", True), ("", "TRUE", True)):
        monkeypatch.setenv("SURVEILNAV_OFFLINE", ours)
        monkeypatch.setenv("HF_HUB_OFFLINE", the_hubs)
        assert offline() is said


def test_the_hub_and_paths_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HF_ENDPOINT", raising=False)
    assert hub_endpoint() == "https://huggingface.co"
    monkeypatch.setenv("HF_ENDPOINT", " https://mirror.org/ ")
    assert hub_endpoint() == "https://mirror.org"
    monkeypatch.setenv("X", "~/a")
    assert path_from_env("X") == Path("~/a").expanduser()
    monkeypatch.setenv("X", " ")
    assert path_from_env("X") is None
