"""All targets of the fuzzer."""

from __future__ import annotations

from tests.fuzz import files, maps, services
from tests.fuzz.target import Target


def all_targets() -> list[Target]:
    """A new instance of each."""
    return [
        maps.Frames(),
        maps.Views(maps.Fusion()),
        maps.FusionTables(),
        maps.FusionQueries(),
        maps.Searches(),
        maps.Texts(),
        services.PerceptionRequests(),
        services.Truths(),
        services.PlannerMaps(),
        services.PlannerMissions(),
        services.RobotRequests(),
        services.GatewayState(),
        services.GatewayAnswers(),
        services.Recorded(),
        *files.file_targets(),
    ]
