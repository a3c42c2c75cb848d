"""Cameras whose description is wrong: once enough of a camera's views say so, none is believed until it is described anew.

Part of a wrong camera's views pass the comparison with the floor (``plausibility``), since they show too little of it. But the
description is the same for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.views.plausibility import find_mistake
from surveilnav.services.fusion.core.views.validation import ViewError

#: So many pictures must disagree with the floor, and so large a share of the views with the newest word of each.
_MIN_PICTURES, _MIN_SHARE = 2, 0.25


@dataclass(slots=True)
class _Camera:
    """What the views of one camera showed. ``mistakes``: the last one by view, "" for a view without; ``n_refused``: pictures."""

    description: dict[int, bytes] = field(default_factory=dict)
    mistakes: dict[int, str] = field(default_factory=dict)
    n_refused: int = 0
    why: str = ""


class Quarantine:
    """Which cameras aren't believed, and why."""

    def __init__(self, config: ValidationConfig) -> None:
        self._config = config
        self._cameras: dict[str, _Camera] = {}

    def check(self, view: PosedView) -> None:
        """Compares a new view with the floor that it must see.

        Raises:
            ViewError: ``geometry_disagrees``, a mistake in its camera's description is found; ``quarantined``: one was found in
                other views of its camera.
        """
        if view.is_robot or view.depth_source != "sensor":
            return
        camera = self._cameras.setdefault(view.source, _Camera())
        description = view.T_world_camera.tobytes() + repr(view.camera).encode()
        if camera.description.setdefault(view.view, description) != description:  # it was calibrated anew
            camera = self._cameras[view.source] = _Camera({view.view: description})
        mistake = find_mistake(view, self._config) or ""
        camera.mistakes[view.view] = mistake
        if mistake:
            camera.n_refused += 1
            n_wrong = sum(map(bool, camera.mistakes.values()))
            if camera.n_refused >= _MIN_PICTURES and n_wrong >= _MIN_SHARE * len(camera.mistakes):
                camera.why = camera.why or mistake
            raise ViewError("geometry_disagrees", mistake)
        if camera.why:
            raise ViewError("quarantined", f"other views of this camera disagree with the floor: {camera.why}")

    def reasons(self) -> dict[str, str]:
        """By source, why a camera isn't believed."""
        return {source: camera.why for source, camera in self._cameras.items() if camera.why}
