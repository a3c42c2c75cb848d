"""How rmw_zenoh writes names: keys of data, liveliness tokens of the graph, and the attachment of each message.

Source: https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md, "Graph Cache", "Publishers" and "Service Clients".
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from typing import Literal

from surveilnav.errors import WireError

#: Kinds of entities in tokens: node, publisher, subscription, service server, service client.
EntityKind = Literal["NN", "MP", "MS", "SS", "SC"]

_TOKENS = "@ros2_lv"
_GID_BYTES = 16
_ATTACHMENT = struct.Struct("<qqB")
_ROS_TYPE = re.compile(r"(\w+)/(msg|srv|action)/(\w+)")
_DDS_TYPE = re.compile(r"(\w+)::(msg|srv|action)::dds_::(\w+)_")
#: The policies that rmw_zenoh leaves out of a token, because they are its defaults.
_DEFAULT_DEPTH = 42
_BEST_EFFORT, _TRANSIENT_LOCAL, _KEEP_ALL = "2", "1", "2"


@dataclass(frozen=True, slots=True)
class Qos:
    """The policies of an endpoint that rmw_zenoh implements. ``depth``: 0 stands for rmw_zenoh's own choice."""

    reliable: bool = True
    transient_local: bool = False
    keep_all: bool = False
    depth: int = 10

    def encode(self) -> str:
        """As in a token: reliability, durability, history and depth, deadline, lifespan, liveliness; defaults are left out."""
        depth = "" if self.depth in (0, _DEFAULT_DEPTH) else str(self.depth)
        history = f"{_KEEP_ALL if self.keep_all else ''},{depth}"
        reliability, durability = (
            "" if self.reliable else _BEST_EFFORT,
            _TRANSIENT_LOCAL if self.transient_local else "",
        )
        return f"{reliability}:{durability}:{history}:,:,:,,"

    @classmethod
    def decode(cls, text: str) -> Qos:
        """From a token. Raises WireError."""
        parts = text.split(":")
        history = parts[2].split(",") if len(parts) >= 6 else []
        if len(history) != 2 or not re.fullmatch(r"\d{0,9}", history[1]):
            raise WireError(f"expected QoS like '::,10:,:,:,,', got {text!r:.80}")
        return cls(
            reliable=parts[0] != _BEST_EFFORT,
            transient_local=parts[1] == _TRANSIENT_LOCAL,
            keep_all=history[0] == _KEEP_ALL,
            depth=int(history[1] or _DEFAULT_DEPTH),
        )


@dataclass(frozen=True, slots=True)
class Entity:
    """A node, or one of its publishers, subscriptions, service servers or clients, as a liveliness token describes it.

    Attributes:
        session: id of its Zenoh session.
        node_id, id: numbers of its node and of itself within the session.
        namespace: the node's, such as ``/robot1``; empty without one.
        name: the full name of the topic or service, such as ``/robot1/odom``; empty for a node.
        type_name: as ROS writes it, such as ``nav_msgs/msg/Odometry``; empty for a node.
        type_hash: ``RIHS01_...``; two ends with different hashes don't hear each other.
    """

    domain: int
    session: str
    node_id: int
    id: int
    kind: EntityKind
    node: str
    namespace: str = ""
    enclave: str = ""
    name: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: Qos = Qos()

    def token(self) -> str:
        """The key of its liveliness token."""
        place = [_TOKENS, str(self.domain), self.session, str(self.node_id), str(self.id), self.kind]
        names = [_mangled(self.enclave), _mangled(self.namespace), _mangled(self.node)]
        if self.kind == "NN":
            return "/".join([*place, *names])
        topic = [_mangled(self.name), dds_type(self.type_name), self.type_hash, self.qos.encode()]
        return "/".join([*place, *names, *topic])

    def data_key(self) -> str:
        """The key of its messages or requests."""
        return data_key(self.domain, self.name, self.type_name, self.type_hash)

    @classmethod
    def from_token(cls, token: str) -> Entity:
        """Raises WireError: it isn't one of rmw_zenoh's tokens."""
        parts = token.split("/")
        kind = parts[5] if len(parts) > 5 else ""
        if parts[0] != _TOKENS or len(parts) != (9 if kind == "NN" else 13):
            raise WireError(f"expected a token of rmw_zenoh, got {token!r:.200}")
        if kind not in ("NN", "MP", "MS", "SS", "SC"):
            raise WireError(f"expected an entity of kind NN, MP, MS, SS or SC, got {kind!r:.20}")
        numbers = [parts[1], parts[3], parts[4]]
        if not all(re.fullmatch(r"\d{1,18}", number) for number in numbers):
            raise WireError(f"expected numbers of domain, node and entity, got {numbers!r:.80}")
        domain, node_id, id = map(int, numbers)
        enclave, namespace, node = (_demangled(part) for part in parts[6:9])
        entity = cls(domain, parts[2], node_id, id, kind, node, namespace, enclave)  # type: ignore[arg-type]
        if kind == "NN":
            return entity
        name, type_name, type_hash, qos = parts[9:]
        return replace(
            entity, name=_demangled(name), type_name=ros_type(type_name), type_hash=type_hash, qos=Qos.decode(qos)
        )


@dataclass(frozen=True, slots=True)
class Attachment:
    """What travels beside each message. ``gid``: 16 bytes, the sender's; a service returns the client's."""

    sequence: int
    stamp_ns: int
    gid: bytes

    def encode(self) -> bytes:
        return _ATTACHMENT.pack(self.sequence, self.stamp_ns, len(self.gid)) + self.gid

    @classmethod
    def decode(cls, data: bytes) -> Attachment:
        """Raises WireError: it isn't one of rmw_zenoh's attachments."""
        if len(data) != _ATTACHMENT.size + _GID_BYTES or data[_ATTACHMENT.size - 1] != _GID_BYTES:
            raise WireError(f"expected an attachment of {_ATTACHMENT.size + _GID_BYTES} bytes, got {data[:40].hex()}")
        sequence, stamp_ns, _ = _ATTACHMENT.unpack_from(data)
        return cls(sequence, stamp_ns, data[_ATTACHMENT.size :])


def tokens_of(domain: int) -> str:
    """A key expression of all tokens of a domain."""
    return f"{_TOKENS}/{domain}/**"


def data_key(domain: int, name: str, type_name: str, type_hash: str) -> str:
    """The key of the messages of a topic, or of the requests to a service. ``*`` as type and hash: of any."""
    return f"{domain}/{name.strip('/')}/{type_name if type_name == '*' else dds_type(type_name)}/{type_hash}"


def type_in_key(key: str) -> str:
    """The ROS type of a message, by the key that it came on. Raises WireError."""
    parts = key.rsplit("/", 2)
    if len(parts) != 3:
        raise WireError(f"expected DOMAIN/TOPIC/TYPE/HASH, got {key!r:.120}")
    return ros_type(parts[1])


def dds_type(type_name: str) -> str:
    """``std_msgs/msg/String`` as DDS writes it: ``std_msgs::msg::dds_::String_``. Raises WireError."""
    match = _ROS_TYPE.fullmatch(type_name)
    if match is None:
        raise WireError(f"expected a type like std_msgs/msg/String, got {type_name!r:.80}")
    return f"{match[1]}::{match[2]}::dds_::{match[3]}_"


def ros_type(dds: str) -> str:
    """The inverse of ``dds_type``. Raises WireError."""
    match = _DDS_TYPE.fullmatch(dds)
    if match is None:
        raise WireError(f"expected a type like std_msgs::msg::dds_::String_, got {dds!r:.80}")
    return f"{match[1]}/{match[2]}/{match[3]}"


def qualified(name: str, namespace: str = "") -> str:
    """The full name of a topic: one without a leading slash lies in the namespace."""
    if name.startswith("/"):
        return name
    return f"/{namespace.strip('/')}/{name}" if namespace.strip("/") else f"/{name}"


def _mangled(name: str) -> str:
    """A key's part may hold no slash, and may not be empty."""
    return name.replace("/", "%") or "%"


def _demangled(part: str) -> str:
    return "" if part == "%" else part.replace("%", "/")
