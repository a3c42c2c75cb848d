"""``python -m services.gateway``: REST and a page at http://127.0.0.1:8080."""

from __future__ import annotations

import signal
import socket
import sys

import uvicorn
from pydantic import ValidationError

from services.gateway.app import create_app
from services.gateway.config import GatewaySettings
from services.gateway.service import Gateway
from surveilnav.bus import BusSettings, Node, logs
from surveilnav.errors import BusError, ConfigError, SurveilNavError


def listen(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises:
        BusError: the port is taken, or the host isn't this machine's.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise BusError(
            f"can't listen at {host} port {port} ({error.strerror or error}). Stop what listens there "
            f"(`ss -ltnp 'sport = :{port}'` shows it) or choose another with SURVEILNAV_GATEWAY__PORT "
            "and SURVEILNAV_GATEWAY__HOST."
        ) from error


def serve(settings: GatewaySettings, bus: BusSettings) -> None:
    """Serves until SIGTERM or SIGINT."""
    with listen(settings.host, settings.port) as sock, Node("gateway", settings.node_id, bus) as node:
        host, port = sock.getsockname()[:2]
        server = uvicorn.Server(
            uvicorn.Config(create_app(Gateway(node)), log_config=None, access_log=False, lifespan="off")
        )
        # uvicorn raises the signal again after it has shut down; the session must still be closed then.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        node.log.info("serving", url=f"http://{f'[{host}]' if ':' in host else host}:{port}/", router=bus.router)
        server.run(sockets=[sock])
        node.log.info("stopped")


def main() -> int:
    try:
        try:
            settings, bus = GatewaySettings(), BusSettings()
        except ValidationError as error:
            raise ConfigError(
                "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
            ) from error
        logs.configure(bus.log_format, bus.log_level)
        serve(settings, bus)
    except SurveilNavError as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
