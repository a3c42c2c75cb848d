"""Pictures and arrays that a client may have already: answered with their ETag, or with 304 and nothing."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

from fastapi import Header, Response

IfNoneMatch = Annotated[str, Header(max_length=1000)]
NOT_CHANGED: dict[int | str, dict[str, Any]] = {304: {"description": "what you have (If-None-Match) is what there is"}}


def answer(body: bytes, media_type: str, headers: dict[str, str], if_none_match: str) -> Response:
    """The bytes, or 304 where the client names their ETag (RFC 9110, section 13.1.2)."""
    tag = f'"{hashlib.sha256(body).hexdigest()[:20]}"'
    headers = {"Cache-Control": "no-cache", "ETag": tag, **headers}
    known = {t.strip().removeprefix("W/") for t in if_none_match.split(",")}
    if tag in known or "*" in known:
        return Response(status_code=304, headers=headers)
    return Response(body, media_type=media_type, headers=headers)
