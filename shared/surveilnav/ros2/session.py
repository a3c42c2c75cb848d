"""A node of a ROS 2 graph on the wire of rmw_zenoh: publishes, subscribes, calls services and serves them."""

from __future__ import annotations

import hashlib
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any

import zenoh
from zenoh.ext import CacheConfig, HistoryConfig, declare_advanced_publisher, declare_advanced_subscriber

from surveilnav.errors import BusError, WireError
from surveilnav.ros2 import types
from surveilnav.ros2.graph import Graph
from surveilnav.ros2.names import Attachment, Entity, EntityKind, Qos, data_key, qualified, tokens_of, type_in_key

_CDR = zenoh.Encoding.APPLICATION_CDR
#: A query that ends so long before its time limit wasn't too slow.
_EARLY_S = 0.05
#: In place of a type's hash: whatever it is.
_ANY = "*"
#: Of an error of Zenoh's: that it couldn't connect, which we say ourselves, and where in its own code it arose.
_INNARDS = re.compile(r"Unable to connect to any of \S*!|\s*at \S+\.rs:\d+\.?")


class RosError(BusError):
    """The other end of the wire isn't there, doesn't answer in time, or answers with an error."""


@dataclass(frozen=True, slots=True, eq=False)
class RosMessage:
    """A message that arrived.

    Attributes:
        topic: its full name.
        data: the message, as rosbags decodes it.
        attachment: its number, when it was sent by the sender's clock, and the sender; None if the sender says nothing.
        received_ns: when it arrived, by this machine's clock.
    """

    topic: str
    type_name: str
    data: Any
    attachment: Attachment | None
    received_ns: int


class RosPublisher:
    """Publishes on one topic. ``encode`` is ``types.encode``."""

    def __init__(self, session: RosSession, entity: Entity) -> None:
        self._entity, self._sequence = entity, 0
        qos = entity.qos
        congestion = zenoh.CongestionControl.BLOCK if qos.reliable and qos.keep_all else zenoh.CongestionControl.DROP
        options: dict[str, Any] = {"encoding": _CDR, "congestion_control": congestion}
        if qos.transient_local:
            cache = CacheConfig(qos.depth)
            self._publisher: Any = declare_advanced_publisher(
                session.zenoh, entity.data_key(), cache=cache, publisher_detection=True, **options
            )
        else:
            self._publisher = session.zenoh.declare_publisher(entity.data_key(), **options)
        self._gid = gid_of(entity)

    def put(self, message: Any) -> None:
        """Publishes a message of ``types.make``."""
        self._sequence += 1
        attachment = Attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(types.encode(message), attachment=attachment.encode())


class RosSession:
    """A node. Use it as a context manager; everything that it declares ends with it.

    Attributes:
        graph: who else is there.
        on_fault: called with a sentence about a message that can't be read; such messages are dropped.
    """

    def __init__(
        self,
        node: str,
        *,
        router: str,
        domain: int = 0,
        namespace: str = "",
        on_fault: Callable[[str], None] = lambda text: None,
    ) -> None:
        """``router``: endpoint of the Zenoh router that the robot's nodes use, such as ``tcp/10.0.0.7:7447``."""
        self._node, self._router, self.domain, self.namespace = node, router, domain, namespace.rstrip("/")
        self.on_fault = on_fault
        self._changed = threading.Condition()
        self.graph = Graph(self._notify)
        self._n_entities = 0
        self._kept: list[Any] = []

    def __enter__(self) -> RosSession:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{self._router}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/shared_memory/enabled", "false")  # as in rmw_zenoh by default
        config.insert_json5("timestamping/enabled", "true")  # which caches of late joiners need
        try:
            self.zenoh = zenoh.open(config)
        except zenoh.ZError as error:
            why = _INNARDS.sub("", str(error)).strip()
            raise RosError(f"no router of the robot at {self._router}{f': {why}' if why else ''}") from error
        self._keep(self.zenoh.liveliness().declare_token(self._entity("NN").token()))
        self._keep(self.zenoh.liveliness().declare_subscriber(tokens_of(self.domain), self._on_token, history=True))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        for kept in reversed(self._kept):
            with suppress(zenoh.ZError):
                kept.undeclare()
        self.zenoh.close()  # type: ignore[no-untyped-call]

    # --- topics ---------------------------------------------------------------------------------------------------

    def publisher(self, topic: str, type_name: str, qos: Qos | None = None) -> RosPublisher:
        """Publishes on a topic. Its type's hash is that of a subscription that is there already, or Jazzy's."""
        name = qualified(topic, self.namespace)
        hashes = [e.type_hash for e in self.graph.endpoints("MS", name) if e.type_name == type_name]
        entity = replace(
            self._entity("MP"),
            name=name,
            type_name=type_name,
            type_hash=hashes[0] if hashes else types.type_hash(type_name),
            qos=qos or Qos(),
        )
        publisher = RosPublisher(self, entity)
        self._keep(self.zenoh.liveliness().declare_token(entity.token()))
        return publisher

    def subscribe(
        self, topic: str, type_name: str, callback: Callable[[RosMessage], None], qos: Qos | None = None
    ) -> None:
        """Has ``callback`` called with every message of a topic, on a thread of Zenoh's.

        Messages of that type are taken whatever their hash is. ``transient_local`` in ``qos``: also those from before.
        """
        name, qos = qualified(topic, self.namespace), qos or Qos()
        key = data_key(self.domain, name, type_name, _ANY)

        def receive(sample: Any) -> None:
            if (message := self._received(name, sample)) is not None:
                callback(message)

        if qos.transient_local:
            history = HistoryConfig(detect_late_publishers=True, max_samples=qos.depth)
            self._keep(declare_advanced_subscriber(self.zenoh, key, receive, history=history))
        else:
            self._keep(self.zenoh.declare_subscriber(key, receive))
        published = [e.type_hash for e in self.graph.endpoints("MP", name) if e.type_name == type_name]
        type_hash = published[0] if published else types.type_hash(type_name)
        entity = replace(self._entity("MS"), name=name, type_name=type_name, type_hash=type_hash, qos=qos)
        self._keep(self.zenoh.liveliness().declare_token(entity.token()))

    def _received(self, name: str, sample: Any) -> RosMessage | None:
        received_ns = time.time_ns()
        try:
            type_name = type_in_key(str(sample.key_expr))
            data = types.decode(sample.payload.to_bytes(), type_name)
            attached = sample.attachment
            attachment = Attachment.decode(attached.to_bytes()) if attached is not None else None
        except WireError as error:
            self.on_fault(f"{name}: {error}")
            return None
        return RosMessage(name, type_name, data, attachment, received_ns)

    # --- services -------------------------------------------------------------------------------------------------

    def call(self, service: str, request: Any, response_type: str, timeout_s: float) -> Any:
        """Calls a service and returns its response. Raises what ``call_encoded`` does, or WireError: it can't be read."""
        return types.decode(self.call_encoded(service, types.encode(request), timeout_s), response_type)

    def call_encoded(self, service: str, request: bytes, timeout_s: float) -> bytes:
        """Calls a service with a request as CDR, and returns its response as CDR.

        The service's type and hash are those of its server's token.

        Raises:
            RosError: no such service is there, or it doesn't answer in time, or with an error.
        """
        name = qualified(service, self.namespace)
        until_s = time.monotonic() + timeout_s
        server = self.wait_for("SS", name, timeout_s)
        client = replace(self._entity("SC"), name=name, type_name=server.type_name, type_hash=server.type_hash)
        attachment = Attachment(1, time.time_ns(), gid_of(client))
        replies = self.zenoh.get(
            server.data_key(),
            payload=request,
            encoding=_CDR,
            attachment=attachment.encode(),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            timeout=max(0.05, until_s - time.monotonic()),
        )
        for reply in replies:
            if reply.ok is not None:
                response: bytes = reply.ok.payload.to_bytes()
                return response
            why = reply.err.payload.to_string()[:200] if reply.err is not None else "none"
            raise RosError(f"service {name} answers with an error: {why}")
        if time.monotonic() < until_s - _EARLY_S:  # Zenoh gives up at once when the only server is gone
            raise RosError(f"service {name} was left without an answer: its node has gone")
        raise RosError(f"service {name} didn't answer within {timeout_s:g} s")

    def serve(
        self,
        service: str,
        type_name: str,
        request_type: str,
        handler: Callable[[Any], Any],
        type_hash: str,
        *,
        waits: bool = False,
    ) -> None:
        """Serves a service: ``handler`` makes a response of a request, on a thread of Zenoh's.

        ``waits``: it may take long; each request then has a thread of its own, and none holds up another.
        """
        name = qualified(service, self.namespace)
        entity = replace(self._entity("SS"), name=name, type_name=type_name, type_hash=type_hash)

        def answer(query: Any) -> None:
            try:
                with query:
                    asked = Attachment.decode(query.attachment.to_bytes() if query.attachment is not None else b"")
                    response = handler(types.decode(query.payload.to_bytes() if query.payload else b"", request_type))
                    attachment = Attachment(asked.sequence, time.time_ns(), asked.gid)
                    query.reply(query.key_expr, types.encode(response), encoding=_CDR, attachment=attachment.encode())
            except WireError as error:
                self.on_fault(f"{name}: {error}")

        def answer_on_a_thread(query: Any) -> None:
            threading.Thread(target=answer, args=(query,), name=service, daemon=True).start()

        self._keep(
            self.zenoh.declare_queryable(entity.data_key(), answer_on_a_thread if waits else answer, complete=True)
        )
        self._keep(self.zenoh.liveliness().declare_token(entity.token()))

    # --- presence -------------------------------------------------------------------------------------------------

    def wait_for(self, kind: EntityKind, name: str, timeout_s: float) -> Entity:
        """The first endpoint of a kind with that full name, once it is there. RosError: not in time."""
        with self._changed:
            found = self._changed.wait_for(lambda: self.graph.endpoints(kind, name), timeout_s)
        if not found:
            what = {"SS": "service", "MP": "publisher of", "MS": "subscription to"}.get(kind, kind)
            raise RosError(f"no {what} {name} in domain {self.domain} at {self._router}")
        return found[0]

    def _entity(self, kind: EntityKind) -> Entity:
        number = self._n_entities
        self._n_entities += 1
        return Entity(self.domain, str(self.zenoh.zid()), 0, number, kind, self._node, self.namespace)

    def _on_token(self, sample: Any) -> None:
        self.graph.update(str(sample.key_expr), present=sample.kind == zenoh.SampleKind.PUT)

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def _keep(self, declared: Any) -> None:
        self._kept.append(declared)


def gid_of(entity: Entity) -> bytes:
    """16 bytes by which ROS tells senders apart. Others compare them and nothing else, so any hash of the token will do."""
    return hashlib.blake2b(entity.token().encode(), digest_size=16).digest()
