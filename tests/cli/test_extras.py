"""A package that is missing is named, with the extra that brings it. Real commands: tests/contract/test_base_installation.py."""

from __future__ import annotations

import pytest

from surveilnav.cli.extras import needs
from surveilnav.errors import MissingExtraError


def run_without(package: str) -> None:
    @needs("simulator")
    def command() -> None:
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)

    command()


def test_a_package_that_is_missing_names_the_extra():
    with pytest.raises(MissingExtraError, match=r"open3d isn't installed: pip install 'surveilnav\[simulator\]'"):
        run_without("open3d.core")


@pytest.mark.parametrize("ours", ["surveilnav.nowhere", ""])
def test_a_module_of_ours_that_is_missing_is_a_bug(ours):
    with pytest.raises(ModuleNotFoundError):
        run_without(ours)
