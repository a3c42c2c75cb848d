"""``python -m surveilnav.services.gateway`` serves REST and a web page at http://127.0.0.1:8080."""

from __future__ import annotations

import signal
import socket
import sys
from datetime import timedelta
from pathlib import Path

import uvicorn

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import run_service
from surveilnav.errors import BusError
from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.app import create_app
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core.hosts import Networks
from surveilnav.services.gateway.service import Gateway

#: The kernel closes a connection whose client hasn't acknowledged the bytes sent to it for this time.
_UNREAD_MS = 30_000


def listen(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises:
        BusError: the port is taken, or the host isn't this machine's.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        sock = socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise BusError(
            f"can't listen at {host} port {port} ({error.strerror or error}). Stop what listens there "
            f"(`ss -ltnp 'sport = :{port}'` shows it) or choose another with SURVEILNAV_GATEWAY__PORT "
            "and SURVEILNAV_GATEWAY__HOST."
        ) from error
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux; connections inherit it
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNREAD_MS)
    return sock


def web_server(
    gateway: Gateway,
    names: frozenset[str] | None,
    root_path: str = "",
    authentication: Authentication | None = None,
    proxies: Networks = (),
) -> uvicorn.Server:
    """A web server for ``gateway``; it ends its streams when it stops. The arguments are those of ``create_app``.

    uvicorn ignores ``X-Forwarded-*``; only the access log uses them, from proxies that the settings name.
    """
    config = uvicorn.Config(
        create_app(gateway, names, authentication, proxies),
        log_config=None,
        access_log=False,
        lifespan="off",
        proxy_headers=False,
        root_path=root_path,
    )
    server = uvicorn.Server(config)
    for source in (gateway.events, gateway.live, gateway.tiles):
        source.ended = lambda: server.should_exit
    return server


def _access_log(settings: GatewaySettings, node: Node) -> AccessLog:
    return AccessLog(
        Path(settings.access_log) if settings.access_log else None,
        keep=timedelta(days=settings.access_log_days),
        max_bytes=settings.access_log_mb << 20,
        trusted_proxies=settings.proxies,
        report_problem=lambda why: node.report_problem("access log", why),
    )


def _authentication(settings: GatewaySettings, node: Node) -> Authentication | None:
    """What lets in those with a key; None: everybody is answered."""
    if not settings.needs_keys:
        return None
    if settings.keys_file is None:
        node.log.warning(
            "nobody is answered: there is no file of API keys",
            do="make one by `surveilnav security key add NAME --role admin` and name it in SURVEILNAV_GATEWAY__KEYS_FILE, or "
            "have everybody answered by SURVEILNAV_GATEWAY__AUTHENTICATION=none",
        )
    return Authentication(settings.keys_file)


def serve(settings: GatewaySettings, bus: BusSettings) -> None:
    """Serves until SIGTERM or SIGINT."""
    with listen(settings.host, settings.port) as sock, Node("gateway", settings.node_id, bus) as node:
        host, port = sock.getsockname()[:2]
        gateway = Gateway(node, settings, _access_log(settings, node))
        keys = _authentication(settings, node)
        server = web_server(gateway, settings.names, settings.root_path, keys, settings.proxies)
        # uvicorn raises the signal again after it has shut down; the session must still be closed then.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        node.log.info("serving", url=f"http://{f'[{host}]' if ':' in host else host}:{port}/", router=bus.router)
        server.run(sockets=[sock])
        node.log.info("stopped")


def main() -> None:
    serve(GatewaySettings(), BusSettings())


if __name__ == "__main__":
    sys.exit(run_service(main))
