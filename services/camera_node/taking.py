"""Takes a camera for this process: the one that its settings name, or any that is free."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from surveilnav.bus import BusSettings, Node
from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.lease import lease

_RETRY_S = 2.0


@contextmanager
def take_camera(
    name: str, list_names: Callable[[], Sequence[str]], where: str, bus: BusSettings
) -> Iterator[tuple[str, Node]]:
    """A camera and its node, until the block ends. Without a ``name``, any free camera, however long it takes to get one.

    Args:
        list_names: lists the cameras that there are; asked again while none is free.
        where: where they are listed, for people.

    Raises:
        ConfigError: there is no camera ``name``; the message lists those that there are.
    """
    if name:
        if name not in (names := list_names()):
            raise ConfigError(f"no camera {name!r} in {where}; it has {list(names)}")
        with Node("camera", name, bus) as node:
            yield name, node
        return
    announced = False
    while True:
        names = list_names()
        with lease(names, bus) as leased:
            if leased is not None:
                yield leased
                return
        if not announced:
            print(f"camera: all {len(names)} cameras of {where} are taken; waiting for one", file=sys.stderr)
            announced = True
        _touch_health_file(bus)
        time.sleep(_RETRY_S)


def _touch_health_file(bus: BusSettings) -> None:
    """Reports a spare replica, which waits for a camera to become free, as healthy."""
    if bus.health_file:
        bus.health_file.parent.mkdir(parents=True, exist_ok=True)
        bus.health_file.touch()
