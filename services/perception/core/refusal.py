"""Why a view gets no answer, before the bus makes an error reply of it."""

from __future__ import annotations

from surveilnav.errors import SurveilNavError


class Refusal(SurveilNavError):  # noqa: N818 - an answer, not a fault
    """A view that won't be looked at.

    Attributes:
        name: one of "busy", "too_late", "superseded", "cancelled", "no_prompt", "bad_prompt", "bad_message".
        retry_after_ms: when the same request may get an answer; None: asking again won't help, or nobody knows.
    """

    def __init__(self, name: str, message: str, retry_after_ms: int | None = None) -> None:
        super().__init__(message)
        self.name, self.retry_after_ms = name, retry_after_ms
