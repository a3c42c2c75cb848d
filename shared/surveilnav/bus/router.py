"""The router: Zenoh in router mode. ``python -m surveilnav.bus.router [--listen tcp/127.0.0.1:7447]``.

With ``--listen tls/HOST:PORT --access access.json`` it lets in only identities of its authority, and each does only what the
rules allow. The files of its own identity are in ``SURVEILNAV_BUS__TLS_CA``, ``_CERTIFICATE`` and ``_KEY``.

It has the same Rust core as zenohd, which may take its place. ``--config FILE`` takes a Zenoh JSON5 file that works for both.
Start zenohd with ``ZENOH_RUNTIME='(rx: (worker_threads: 8), tx: (worker_threads: 8))'``, as ``main`` does here.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import zenoh
from pydantic import ValidationError

import surveilnav
from surveilnav.bus import logs
from surveilnav.bus.main import end_with_stdin
from surveilnav.bus.settings import DEFAULT_PORT, BusSettings, host_and_port, is_encrypted, router_config
from surveilnav.bus.tls import TlsFiles
from surveilnav.contract import ROUTER, VERSION
from surveilnav.errors import BusError, ConfigError, SurveilNavError, explain_settings_error

#: Closing the link of a reader that doesn't read occupies a thread of Zenoh. By default there are one to send and two to
#: receive; when all are occupied, nobody reaches the router (docs/understand/adr/0006-bulk-data-is-left-out.md).
_THREADS = "(rx: (worker_threads: 8), tx: (worker_threads: 8))"


def open_router(
    listen: str, files: TlsFiles | None = None, access: Path | None = None, connect: Sequence[str] = ()
) -> zenoh.Session:
    """Opens a router that listens at ``tcp/HOST:PORT``, or at ``tls/HOST:PORT`` with an identity and access rules.

    Close the session to end it.

    Args:
        connect: endpoints of other routers, with which it makes one bus. They needn't be there yet.

    Raises:
        BusError: an endpoint is malformed, the port is taken, or the host isn't this machine's.
        ConfigError: something is wrong with the identity's files or the rules, or one is there without the other.
    """
    try:
        host, port = host_and_port(listen)
    except ValueError as error:
        raise BusError(f"the router's --listen: {error}, got {listen!r}") from None
    _check_joined(listen, connect)
    rules = _secured(listen, files, access)
    _check_free(host, port)
    try:
        config = zenoh.Config.from_json5(router_config(listen, files, rules, connect))
    except zenoh.ZError as error:
        raise ConfigError(
            f"Zenoh can't read the access rules {access}: `surveilnav security rules` makes them anew ({error})"
        ) from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise BusError(f"the router can't listen at {listen}: {error}") from error


def announce_release(session: zenoh.Session) -> zenoh.LivelinessToken:
    """Tells nodes which contract is spoken here, as long as the token is kept."""
    return session.liveliness().declare_token(ROUTER.format(contract=VERSION, release=surveilnav.__version__))


def _secured(listen: str, files: TlsFiles | None, access: Path | None) -> dict[str, object] | None:
    """The access rules, after all files were checked; None for a router without security. Raises ConfigError."""
    if not is_encrypted(listen):
        if files or access:
            raise ConfigError(
                f"with access rules or an identity the router listens at tls/HOST:PORT, got {listen!r:.100}"
            )
        return None
    if files is None or access is None:
        raise ConfigError(
            "a router at tls/HOST:PORT needs --access access.json, and its identity in SURVEILNAV_BUS__TLS_CA, "
            "SURVEILNAV_BUS__TLS_CERTIFICATE and SURVEILNAV_BUS__TLS_KEY: `surveilnav security init` makes them"
        )
    if (name := files.check()) != "router":
        raise ConfigError(f"the router's certificate is for {name!r}, not for 'router': {files.certificate}")
    try:
        rules = json.loads(access.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"the access rules {access} can't be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            f"the access rules {access} aren't JSON ({error}): `surveilnav security rules` makes them anew"
        ) from None
    if not isinstance(rules, dict) or rules.get("enabled") is not True or rules.get("default_permission") != "deny":
        raise ConfigError(
            f"expected access rules that are enabled and deny by default in {access}: `surveilnav security rules` makes them anew"
        )
    return rules


def _check_joined(listen: str, connect: Sequence[str]) -> None:
    """Raises BusError if an endpoint of another router is malformed, or is encrypted where this one isn't."""
    for endpoint in connect:
        try:
            host_and_port(endpoint)
        except ValueError as error:
            raise BusError(f"the router's --connect: {error}, got {endpoint!r}") from None
        if is_encrypted(endpoint) != is_encrypted(listen):
            raise BusError(
                f"joined routers are all at tcp/ or all at tls/: this one listens at {listen}, got {endpoint}"
            )


def _check_free(host: str, port: int) -> None:
    """Raises BusError if the port is taken, which Zenoh's own error doesn't say."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.create_server((host, port), family=family):
            pass
    except OSError as error:
        raise BusError(
            f"port {port} at {host} is taken or not this machine's ({error.strerror}). Stop what listens there "
            f"(`ss -ltnp 'sport = :{port}'` shows it) or choose another with --listen tcp/HOST:PORT "
            "and SURVEILNAV_BUS__ROUTER."
        ) from error


def _identity(listen: str) -> TlsFiles | None:
    """The router's own identity, from the environment."""
    return BusSettings(router=listen).tls_files if is_encrypted(listen) else None


def free_port() -> int:
    """A TCP port of the loopback interface that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def main(argv: list[str] | None = None) -> int:
    """Runs the router until SIGTERM or SIGINT; returns the process's exit code."""
    parser = argparse.ArgumentParser(prog="surveilnav.bus.router", description=__doc__)
    parser.add_argument("--listen", default=f"tcp/127.0.0.1:{DEFAULT_PORT}", help="tcp/HOST:PORT or tls/HOST:PORT")
    parser.add_argument(
        "--access", type=Path, help="the access rules, with tls/: access.json of `surveilnav security init`"
    )
    parser.add_argument(
        "--connect",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help="another machine's router, tcp/HOST:PORT or tls/HOST:PORT, to make one bus with; may be given several times",
    )
    parser.add_argument("--config", type=Path, help="a Zenoh JSON5 file instead of the built-in settings")
    arguments = parser.parse_args(argv)
    logs.configure()
    os.environ.setdefault("ZENOH_RUNTIME", _THREADS)
    stopping = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.set())
    end_with_stdin()
    try:
        if arguments.config:
            if not arguments.config.is_file():
                raise ConfigError(f"no such router configuration: {arguments.config}")
            session = zenoh.open(zenoh.Config.from_file(str(arguments.config)))
        else:
            session = open_router(arguments.listen, _identity(arguments.listen), arguments.access, arguments.connect)
    except ValidationError as error:
        print(explain_settings_error(error), file=sys.stderr)
        return 1
    except (SurveilNavError, zenoh.ZError) as error:
        print(f"router: {error}", file=sys.stderr)
        return 1
    with session:
        _token = announce_release(session)
        print(f"router: listening at {arguments.config or arguments.listen}", file=sys.stderr, flush=True)
        stopping.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
