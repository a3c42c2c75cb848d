from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.config import cache_dir, models_dir
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
