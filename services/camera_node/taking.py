"""Takes a camera for this process: the one that its settings name, or any that is free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.lease import take_slot
from surveilnav.errors import ConfigError


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
    with take_slot("camera", list_names, bus, where) as taken:
        yield taken
