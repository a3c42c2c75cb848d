"""Which camera a process takes."""

from __future__ import annotations

import pytest

from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.taking import take_camera

NAMES = ["c1", "c2"]


def test_a_camera_by_name(bus):
    with take_camera("c2", lambda: NAMES, "cameras.yaml", bus) as (name, node):
        assert (name, node.id) == ("c2", "c2")
    with pytest.raises(ConfigError, match=r"no camera 'c9' in cameras\.yaml; it has \['c1', 'c2'\]"):  # noqa: SIM117
        with take_camera("c9", lambda: NAMES, "cameras.yaml", bus):
            pass


def test_without_a_name_any_that_is_free(bus):
    with (
        take_camera("", lambda: NAMES, "cameras.yaml", bus) as first,
        take_camera("", lambda: NAMES, "cameras.yaml", bus) as second,
    ):
        assert {first[0], second[0]} == set(NAMES)
