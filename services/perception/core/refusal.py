"""Why a request gets no reply. The service turns it into an error reply on the bus."""

from __future__ import annotations

from surveilnav.errors import SurveilNavError


class Refusal(SurveilNavError):  # noqa: N818 - an outcome, not a fault
    """A request that isn't processed.

    Attributes:
        name: one of "busy", "too_late", "superseded", "cancelled", "no_prompt", "bad_prompt", "bad_message".
        retry_after_ms: when the same request may be accepted; None if repeating it is of no use, or nobody knows.
    """

    def __init__(self, name: str, message: str, retry_after_ms: int | None = None) -> None:
        super().__init__(message)
        self.name, self.retry_after_ms = name, retry_after_ms
