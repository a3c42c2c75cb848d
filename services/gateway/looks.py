"""Looks at cameras: noted where a picture goes out, told where somebody asks who looked."""

from __future__ import annotations

from starlette.requests import HTTPConnection

from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.core.proxies import Networks, client_address
from surveilnav.services.gateway.core.resources import CameraLook

#: Instead of a view: somebody was shown all of them.
ALL_VIEWS = -1


class Looks:
    """Whatever shows a camera's picture to somebody calls ``note``, each time that it does."""

    def __init__(self, log: AccessLog | None = None, trusted: Networks = ()) -> None:
        """``trusted``: the proxies that are believed whom they ask for."""
        self._log, self._trusted = log or AccessLog(), trusted

    def note(self, request: HTTPConnection, camera: str, view: int, what: str) -> None:
        """Notes that whoever sent ``request`` is shown a view now, as "thumbnail", "latest", "tile", "history" or "recording"."""
        peer = request.client.host if request.client else ""
        client = client_address(peer, request.headers.getlist("x-forwarded-for"), self._trusted)
        self._log.note(client, camera, view, what)

    def of(self, camera: str) -> list[CameraLook]:
        """The newest looks at a camera, newest first; none at one that nobody knows."""
        return [CameraLook(time=k.time, client=k.client, view=k.view, what=k.what) for k in self._log.of(camera)]

    def tidy(self) -> None:
        """Removes files of lines that are too old. Call it now and then: nobody may look for months."""
        self._log.tidy()
