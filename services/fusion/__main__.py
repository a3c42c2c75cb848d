"""``python -m surveilnav.services.fusion`` runs the fusion service, which keeps the joint maps of a building."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.lease import take_slot
from surveilnav.bus.main import run_service, run_warm_up
from surveilnav.pictures import PictureSettings
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core.warm_up import warm_up
from surveilnav.services.fusion.service import FusionService
from surveilnav.services.fusion.shard import WHOLE_BUILDING, Shard


def main() -> None:
    """Runs the service until it is told to stop."""
    settings = FusionSettings()
    config = settings.core()
    run_warm_up(lambda: warm_up(config))  # before fusion announces itself on the bus
    with _shard(settings, BusSettings()) as (shard, node, own_settings):
        service = FusionService(node, own_settings, PictureSettings().keep_s, shard)
        node.run(service.step)
        service.close()


@contextmanager
def _shard(settings: FusionSettings, bus: BusSettings) -> Iterator[tuple[Shard, Node, FusionSettings]]:
    """The part of the building that this process maps, its node, and its settings. Waits until a part is free."""
    if not settings.shards:
        with Node("fusion", WHOLE_BUILDING.name, bus) as node:
            yield WHOLE_BUILDING, node, settings
        return
    with take_slot("fusion", lambda: sorted(settings.shards), bus, "SURVEILNAV_FUSION__SHARDS") as (name, node):
        node.log.info("maps a part of the building", shard=name, floors=settings.shards[name])
        yield settings.shard(name), node, settings.for_shard(name)


if __name__ == "__main__":
    sys.exit(run_service(main))
