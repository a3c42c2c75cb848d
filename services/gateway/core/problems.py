"""Errors as RFC 9457 problem details, and which HTTP status each name of an error has."""

from __future__ import annotations

from typing import Any

TYPE = "urn:surveilnav:problem:"
MEDIA_TYPE = "application/problem+json"

#: The statuses of the error names with which planner, fusion and other nodes refuse. Names that aren't here are conflicts: 409.
STATUS_OF = {
    "bad_target": 422,
    "bad_message": 422,
    "bad_goal": 422,
    "bad_source": 422,
    "bad_span": 422,
    "bad_room": 422,
    "unknown_source": 422,
    "unknown_robot": 422,
    "unknown_target": 422,
    "not_found": 404,
    "unknown_mission": 404,
    "unknown_floor": 404,
    "unknown_layer": 404,
    "unknown_camera": 404,
    "unknown_view": 404,
    "bad_view": 404,
    "no_plan": 404,
    "no_picture": 404,
    "no_traffic": 404,
    "unknown_picture": 404,
    "unknown_recording": 404,
    "busy": 503,
    "queue_full": 503,
    "perception_down": 503,
    "fusion_down": 503,
    "store_failed": 503,
    "store_down": 503,
    "disk_down": 503,
    "internal": 502,
    "perception_failed": 502,
    "too_late": 504,
}
_TITLES = {
    400: "Bad request",
    403: "Not allowed",
    404: "Not found",
    405: "Method not allowed",
    409: "Conflict",
    413: "Too large",
    416: "Not in the file",
    415: "Unsupported media type",
    421: "Not for this gateway",
    422: "Can't be accepted",
    500: "Internal error",
    502: "A service answered wrongly",
    503: "A service is missing",
    504: "A service didn't answer in time",
}


class Problem(Exception):  # noqa: N818  # the word of RFC 9457
    """Why a request can't be answered as asked; it becomes an RFC 9457 problem.

    ``name`` ends the problem's type (``urn:surveilnav:problem:{name}``), ``more`` adds members.
    """

    def __init__(self, status: int, name: str, detail: str, **more: Any) -> None:
        super().__init__(detail)
        self.status, self.name, self.detail, self.more = status, name, detail, more

    def body(self, instance: str) -> dict[str, Any]:
        """The members of RFC 9457, section 3.1."""
        return {
            "type": TYPE + self.name,
            "title": _TITLES.get(self.status, "Error"),
            "status": self.status,
            "detail": self.detail,
            "instance": instance,
            **self.more,
        }


def refusal(name: str, message: str) -> Problem:
    """The problem for an error name from the bus. Remote text is cut, as its sender may have made it any length."""
    status = STATUS_OF.get(name, 409)
    return Problem(status, name[:64] or "refused", message[:2000] or f"refused: {name[:64] or 'no reason given'}")


def invalid(errors: list[dict[str, Any]]) -> Problem:
    """The problem for pydantic's list of validation errors. It says where each is, and what is expected there."""
    broken = any(e.get("type") == "json_invalid" for e in errors)
    found = [
        {"where": ".".join(str(p) for p in e.get("loc", ())), "message": str(e.get("msg", ""))} for e in errors[:20]
    ]
    detail = "; ".join(f"{e['where']}: {e['message']}" for e in found) or "the request can't be read"
    return Problem(400 if broken else 422, "malformed" if broken else "invalid", detail[:2000], errors=found)
