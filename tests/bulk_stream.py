"""A stream for tests of the bus: small messages beside large payloads, which a full link may leave out."""

from __future__ import annotations

from dataclasses import replace

from surveilnav.contract import TRUTH

BULK = replace(TRUTH, name="bulk", kind="put")
