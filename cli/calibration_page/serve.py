"""The web server of the page, on this machine only, until Ctrl-C."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import sys
import webbrowser
from collections.abc import Callable

import uvicorn

from surveilnav.cli.calibration_page.app import create_app
from surveilnav.cli.calibration_page.session import Session
from surveilnav.errors import ConfigError

_ADDRESS = "127.0.0.1"


def serve(session: Session, port: int, browser: bool, announce: Callable[[str], None]) -> None:
    """Serves the page until Ctrl-C.

    Args:
        port: 0: any that is free.
        browser: whether one is opened.
        announce: called with the page's address.

    Raises:
        ConfigError: the port is taken.
    """
    try:
        listening = socket.create_server((_ADDRESS, port))
    except OSError as error:
        raise ConfigError(f"--port {port}: {error.strerror}; name another one, or none") from None
    secret = secrets.token_urlsafe(16)
    config = uvicorn.Config(
        create_app(session, secret), log_level="warning", access_log=False, lifespan="off", timeout_graceful_shutdown=1
    )
    with listening:
        url = f"http://{_ADDRESS}:{listening.getsockname()[1]}/{secret}/"
        announce(url)
        if browser and _has_screen():
            webbrowser.open(url)
        with contextlib.suppress(KeyboardInterrupt):  # uvicorn raises it again after it has shut down
            uvicorn.Server(config).run(sockets=[listening])


def _has_screen() -> bool:
    """On a Linux machine without one, Python would open a browser in the terminal."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
