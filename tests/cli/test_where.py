"""What ``surveilnav where`` prints."""

from __future__ import annotations

import copy
import io

from rich.console import Console

from surveilnav.cli.where import show_sightings
from surveilnav.rest import Sightings, examples


def printed(**changes: object) -> str:
    out = io.StringIO()
    found = Sightings.model_validate({**copy.deepcopy(examples.SIGHTINGS), **changes})
    show_sightings(found, Console(file=out, width=140))
    return out.getvalue()


def test_a_sighting_is_a_line_with_its_room_and_uncertainty() -> None:
    out = printed()
    (line,) = (line for line in out.splitlines() if "couch" in line)
    for part in ("couch 17", "6.0, 1.2", "lounge", "0.14", "confirmed", "0.81", "camera/lobby"):
        assert part in line


def test_rooms_that_nobody_sees_are_named() -> None:
    out = printed()
    assert "no camera sees store (floor 0)" in out
    assert "less than half" not in out
    half = [{"floor": "0", "name": "lounge", "in_view": 0.3, "cameras": ["lobby"]}]
    out = printed(rooms=half, sightings=[])
    assert "no camera sees a couch" in out
    assert "cameras see less than half of lounge (floor 0)" in out
    assert "store" not in out


def test_a_camera_that_gave_nothing_is_named() -> None:
    lacking = [{"id": "yard", "views": 1, "views_processed": 0, "lacking": "paused"}]
    assert "camera yard wasn't looked at: paused" in printed(cameras=lacking)
