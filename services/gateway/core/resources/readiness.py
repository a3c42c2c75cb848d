"""Whether a mission could run now."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

#: What must be there before a mission makes sense, and how to start it.
NEEDED: tuple[tuple[Literal["robot", "perception", "fusion", "planner"], str], ...] = (
    ("robot", "python -m surveilnav.services.robot_node"),
    ("perception", "python -m surveilnav.services.perception"),
    ("fusion", "python -m surveilnav.services.fusion"),
    ("planner", "python -m surveilnav.services.planner"),
)


class Readiness(BaseModel):
    ready: bool
    missing: list[str]
    checks: dict[str, str] = Field(description="per part: who is there, or what is missing and how to start it")

    @classmethod
    def of(cls, routers: int, alive: dict[str, set[str]]) -> Readiness:
        """Ready: a session to a router, and one living node of each kind needed. ``alive``: ids by kind."""
        checks = {
            "router": "connected" if routers else "missing: no session to the router; start it with `surveilnav up`"
        }
        for kind, command in NEEDED:
            ids = sorted(alive.get(kind, set()))
            checks[kind] = ", ".join(ids) if ids else f"missing: none has announced itself; start one with `{command}`"
        missing = [name for name, found in checks.items() if found.startswith("missing: ")]
        return cls(ready=not missing, missing=missing, checks=checks)
