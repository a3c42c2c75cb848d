from __future__ import annotations

import shutil
import sys
from importlib import metadata

import pytest

from surveilnav.code_fingerprint import code_fingerprint


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two files that the test may change; ids aren't remembered."""
    folder = tmp_path / "made_for_a_test"
    (folder / "data").mkdir(parents=True)
    (folder / "__init__.py").write_text("a = 1\n")
    (folder / "data" / "words.json").write_text("{}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield folder
    sys.modules.pop(folder.name, None)
    shutil.rmtree(folder)


def anew(*names):
    code_fingerprint.cache_clear()
    return code_fingerprint(*names)


@pytest.mark.parametrize("file", ["__init__.py", "data/words.json"])
def test_a_changed_file_is_another_program(package, file):
    first = anew(package.name)
    assert anew(package.name) == first
    (package / file).write_text("b = 2\n")
    assert anew(package.name) != first


def test_a_new_version_of_a_library_is_another_program(package, monkeypatch):
    first = anew(package.name)
    monkeypatch.setattr(metadata, "version", lambda name: "999")
    assert anew(package.name) != first


def test_what_is_no_package_is_a_mistake():
    with pytest.raises(ModuleNotFoundError, match="no_such_thing"):
        anew("no_such_thing")
