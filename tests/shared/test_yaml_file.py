"""YAML that people or others wrote, and that is more than a table of words."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from surveilnav.cameras_file import load_cameras
from surveilnav.errors import ConfigError
from surveilnav.yaml_file import ShallowLoader, compose, plain

_LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("floors: {[1, 2]: 3}\n", "line 1: expected a word before the colon"),
        ("a:\n  ? {b: 1}\n  : 2\n", "line 2: expected a word before the colon"),
        ("a: &a [*a]\n", "a file of cameras is simpler than this"),
        ("a: " + "[" * 60 + "]" * 60, "a file of cameras is simpler than this"),
        ("a: " + "[" * 5000, "isn't YAML"),
        (_LAUGHS, "a file of cameras is simpler than this"),
    ],
    ids=["list as a key", "table as a key", "list in itself", "deep", "too deep", "many by aliases"],
)
def test_what_is_more_than_words_and_tables_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        compose(tmp_path / "cameras.yaml", "file of cameras", text)


def test_reading_stops_at_more_brackets_than_anybody_writes() -> None:
    with pytest.raises(yaml.YAMLError, match="open brackets") as refused:
        yaml.compose("[" * 400, ShallowLoader)
    assert refused.value.problem_mark.column == 100  # what comes behind would take longer with each bracket


def test_a_date_that_doesnt_exist_is_named_with_its_line(tmp_path: Path) -> None:
    root = compose(tmp_path / "a.yaml", "file", "x: 1\nbuilding: 2026-02-30\n")
    assert root is not None
    with pytest.raises(ValueError, match="line 2: day is out of range"):
        plain(root)
    text = "building: 2026-02-30\nfloors: {a: {z_m: 0}}\ncameras: []\n"
    with pytest.raises(ConfigError, match="building: line 1: day is out of range"):
        load_cameras(tmp_path / "cameras.yaml", text)


def test_as_text_nothing_is_read_as_a_number(tmp_path):
    root = compose(tmp_path / "f.yaml", "file", "a: 0123\nb: [12:34, 1_000, ~]\nc: {d: yes}\n")
    assert plain(root, as_text=True) == {"a": "0123", "b": ["12:34", "1_000", None], "c": {"d": "yes"}}
