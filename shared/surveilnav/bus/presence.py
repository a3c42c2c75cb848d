"""Which nodes are present: those whose liveliness token the router holds.

A name belongs to one process. One that finds its name taken waits until it is free: the token of a killed process goes with
its connection, and after a power cut with the router's lease. If it stays taken, the process ends with an error. Two that start
at the same moment find each other; the one whose session id is smaller stays.

A node works only with a router that speaks its contract. One of another release ends with an error, also when the router was
replaced under it. A router of Zenoh's own, zenohd, doesn't say which contract is spoken.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import zenoh

import surveilnav
from surveilnav.bus.connection import Connection
from surveilnav.contract import INSTANCE, LIVELINESS, ROUTER, VERSION
from surveilnav.errors import BusError, NameTakenError

#: So long a node waits for its name. The router drops a session that it hears nothing of after 10 s.
NAME_WAIT_S = 12.0
_POLL_S = 0.2


class Presence:
    """Announces nodes of this process, and knows which others are present."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._watchers: dict[str, _Watcher] = {}

    def announce(self, kind: str, id: str, *, waits: bool = True) -> None:
        """Announces a node until the connection closes.

        Args:
            kind, id: the kind and name of the node.
            waits: whether it waits until the name is free.

        Raises:
            NameTakenError: another process has this name.
            BusError: the router speaks another contract.
        """
        self._check_contract(kind)
        session = self._connection.session
        own, name = str(session.info.zid()), {"building": self._connection.building, "kind": kind, "id": id}
        taken = (
            f"a {kind} named {id!r} is on the bus already, and of two with one name nobody can tell whose word is whose"
        )
        refusal = f"{taken}: stop it, or give this one another name"
        until_s = time.monotonic() + (NAME_WAIT_S if waits else 0.0)
        while self._instances(name):
            if time.monotonic() > until_s:
                raise NameTakenError(refusal)
            time.sleep(_POLL_S)
        self._connection.keep(session.liveliness().declare_token(INSTANCE.format(**name, zid=own)))

        def yield_to(sample: Any) -> None:
            if sample.kind == zenoh.SampleKind.PUT and str(sample.key_expr).rsplit("/", 1)[1] < own:
                # one that doesn't wait for its name looks for another
                (self._connection.log.error if waits else self._connection.log.info)(f"{taken}: this one ends")
                self._connection.stop()

        pattern = INSTANCE.format(**name, zid="*")
        self._connection.keep(session.liveliness().declare_subscriber(pattern, yield_to))
        if any(other < own for other in self._instances(name)):
            raise NameTakenError(refusal)
        token = LIVELINESS.format(building=self._connection.building, kind=kind, id=id)
        self._connection.keep(self._connection.session.liveliness().declare_token(token))

    def _check_contract(self, kind: str) -> None:
        """Raises BusError if the router speaks another contract; ends the process if one comes that does."""
        liveliness, pattern = self._connection.session.liveliness(), ROUTER.format(contract="*", release="*")

        def refusal_by(sample: Any) -> str:
            """Why this node can't work with a router; empty if it can."""
            contract, release = str(sample.key_expr).rsplit("/", 2)[1:]
            if contract == str(VERSION):
                return ""
            return (
                f"the router at {self._connection.settings.router} is of release {release} and speaks contract {contract}, "
                f"but this {kind} is of release {surveilnav.__version__} and speaks contract {VERSION}: run one release"
            )

        def check_newcomer(sample: Any) -> None:
            if sample.kind == zenoh.SampleKind.PUT and (refusal := refusal_by(sample)):
                self._connection.log.error(f"{refusal}. This one ends")
                self._connection.stop()

        for reply in liveliness.get(pattern, timeout=1.0):
            if reply.ok is not None and (refusal := refusal_by(reply.ok)):
                raise BusError(refusal)
        self._connection.keep(liveliness.declare_subscriber(pattern, check_newcomer, history=True))

    def _instances(self, name: dict[str, str]) -> set[str]:
        """The session ids of the processes that have a name now."""
        pattern = INSTANCE.format(**name, zid="*")
        replies = self._connection.session.liveliness().get(pattern, timeout=1.0)
        return {str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in replies if reply.ok is not None}

    def alive(self, kind: str) -> set[str]:
        """Ids of the nodes of a kind that are present now. The first call for a kind subscribes to its changes."""
        watcher = self._watchers.get(kind)
        if watcher is None:
            watcher = self._watchers[kind] = _Watcher(self._connection, kind)
        return watcher.ids()

    def routers(self) -> int:
        """Number of routers that this process is connected to now."""
        return len(self._connection.session.info.routers_zid())


class _Watcher:
    """The ids of the present nodes of one kind."""

    def __init__(self, connection: Connection, kind: str) -> None:
        self._connection = connection
        self._ids: set[str] = set()
        self._lock = threading.Lock()
        pattern = LIVELINESS.format(building=connection.building, kind=kind, id="*")
        liveliness = connection.session.liveliness()
        self._subscriber = liveliness.declare_subscriber(pattern, self._on_change, history=True)
        for reply in liveliness.get(pattern, timeout=1.0):
            if reply.ok is not None:
                self._on_change(reply.ok)

    def _on_change(self, sample: Any) -> None:
        id = str(sample.key_expr).rsplit("/", 1)[1]
        with self._lock:
            (self._ids.add if sample.kind == zenoh.SampleKind.PUT else self._ids.discard)(id)
        self._connection.wake.set()

    def ids(self) -> set[str]:
        """A copy of the present ids."""
        with self._lock:
            return set(self._ids)
