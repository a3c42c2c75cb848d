"""A made-up run: what a report is written of."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from surveilnav.cli.report.record import RunRecord
from surveilnav.messages import CameraInfo
from tests.made_up_run import made_up_run, make_camera


@pytest.fixture
def camera() -> Callable[..., CameraInfo]:
    return make_camera


@pytest.fixture
def record() -> RunRecord:
    return made_up_run()
