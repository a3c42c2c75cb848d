"""Access rules: what each identity may do on the bus, from the contract.

The router applies them to what it receives from an identity ("ingress") and to what it sends to it ("egress"). What no rule
allows is refused. Everything here is a pure function of the contract and the two tables below; a stream that is missing there
fails a test.

A key in a message must lie within a key of a rule. So a rule that lets somebody ask all cameras has the wildcard in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from surveilnav import contract
from surveilnav.contract import INSTANCE, LIVELINESS, ROOT, ROUTER, SIMULATION, STREAMS, Stream
from surveilnav.security.identities import Identity, Kind

#: Zenoh's names of the messages that rules are about.
Message = Literal[
    "put",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]
Flow = Literal["ingress", "egress"]

_CAMERAS: frozenset[Kind] = frozenset({"camera", "cameras"})
_SERVICES: frozenset[Kind] = frozenset({"fusion", "planner", "gateway", "recorder", "perception"})
#: Those who may see which nodes are present.
_SEE_PRESENCE: frozenset[Kind] = _SERVICES | {"supervisor", "viewer"}

#: Who publishes and answers, by ``Stream.owner``.
OWNERS: dict[str, frozenset[Kind]] = {
    "camera_node": _CAMERAS,
    "robot_node": frozenset({"robot"}),
    "perception": frozenset({"perception"}),
    "fusion": frozenset({"fusion"}),
    "planner": frozenset({"planner"}),
    "recorder": frozenset({"recorder"}),
    "every node": _SERVICES | _CAMERAS | {"robot"},
    "surveilnav replay": frozenset(),  # a replay has a router of its own, on this machine alone
    "surveilnav up": frozenset({"supervisor"}),
    "a bridge to doors and lifts": frozenset({"doors"}),
    "simulator nodes": _CAMERAS | {"robot"},
}


def _kinds(*kinds: Kind) -> frozenset[Kind]:
    return frozenset(kinds)


#: Who subscribes to a stream or queries it, by its name. Pictures of cameras and robots go to fusion; the gateway asks cameras
#: for single ones, and shows them to people by their role.
READERS: dict[str, frozenset[Kind]] = {
    "camera_info": _kinds("fusion", "gateway", "recorder", "supervisor", "viewer"),
    "camera_frame": _kinds("fusion"),
    "camera_summary": _kinds("planner", "gateway", "recorder"),
    "camera_request": _kinds("fusion", "gateway"),
    "robot_observation": _kinds("fusion"),
    "robot_status": _kinds("fusion", "planner", "gateway", "recorder", "supervisor", "viewer"),
    "robot_command": _kinds("planner"),
    "robot_halt": _kinds("gateway"),
    "passage_state": _kinds("planner"),
    "floor_areas": _kinds("gateway"),
    "perception_infer": _kinds("fusion"),
    "perception_text": _kinds("fusion", "planner", "gateway", "recorder"),
    "perception_load": _kinds("fusion", "planner", "gateway", "recorder", "supervisor", "viewer"),
    "floor_maps": _kinds("planner"),
    "map_layer": _kinds("gateway", "recorder"),
    "map_revision": _kinds("planner", "gateway", "recorder", "viewer"),
    "objects": _kinds("gateway", "recorder"),
    "camera_search": _kinds("planner", "gateway"),
    "view_picture": _kinds("gateway"),
    "forget_pictures": _kinds("gateway"),
    "remove_from_maps": _kinds("gateway"),
    "map_removals": _kinds("gateway"),
    "view_log": _kinds("recorder"),
    "map_snapshot": _kinds("recorder"),
    "mission_goal": _kinds("gateway"),
    "mission_cancel": _kinds("gateway"),
    "mission_pause": _kinds("gateway"),
    "mission_status": _kinds("fusion", "gateway", "recorder", "viewer"),
    "mission_plan": _kinds("gateway", "recorder", "viewer"),
    "traffic": _kinds("gateway", "recorder", "viewer"),
    "recorder_status": _kinds("gateway", "viewer"),
    "recordings": _kinds("gateway"),
    "recording_read": _kinds("gateway"),
    "recording_delete": _kinds("gateway"),
    "replay": _kinds("gateway"),
    "replay_control": _kinds("gateway"),
    "services": _kinds("gateway", "recorder", "viewer"),
    "truth": _kinds("perception"),
    "judged": _kinds("gateway"),
}
#: Who reads a stream in simulation, beside those above: a simulated robot judges its stop by the mission's target.
_READERS_IN_SIMULATION: dict[str, frozenset[Kind]] = {contract.MISSION_STATUS.name: _kinds("robot")}


@dataclass(frozen=True, slots=True)
class Rule:
    """Allows messages of some kinds with keys within ``keys``."""

    flow: Flow
    messages: tuple[Message, ...]
    keys: tuple[str, ...]


def may_own(kind: Kind, stream: Stream) -> bool:
    """Whether identities of a kind publish or answer this stream."""
    return kind in OWNERS[stream.owner]


def may_read(kind: Kind, stream: Stream, simulation: bool = False) -> bool:
    """Whether identities of a kind subscribe to this stream or query it."""
    more = _READERS_IN_SIMULATION.get(stream.name, frozenset()) if simulation else frozenset()
    return kind in READERS[stream.name] | more


def rules_of(identity: Identity, building: str, *, simulation: bool = False) -> list[Rule]:
    """What an identity may do. ``simulation``: whether the truth channel exists."""
    streams = [s for s in STREAMS if simulation or s not in SIMULATION]
    if identity.kind == "router":
        return _joined_router_rules(streams, building)
    owned = [s for s in streams if may_own(identity.kind, s)]
    read = [s for s in streams if may_read(identity.kind, s, simulation)]
    rules = [
        _rule("ingress", ("put",), (own_key(s, building, identity) for s in owned if "put" in s.kind)),
        # Of its subscribers a publisher hears from the router: without, it would publish nothing.
        _rule("egress", ("declare_subscriber",), (every_key(s, building) for s in owned if "put" in s.kind)),
        _rule(
            "ingress",
            ("declare_queryable", "reply"),
            (own_key(s, building, identity) for s in owned if "query" in s.kind),
        ),
        # The router sends an identity only queries that meet what it has declared: those of its own keys.
        _rule("egress", ("query",), (every_key(s, building) for s in owned if "query" in s.kind)),
        _rule("ingress", ("declare_subscriber",), (every_key(s, building) for s in read if "put" in s.kind)),
        _rule("egress", ("put",), (every_key(s, building) for s in read if "put" in s.kind)),
        _rule("ingress", ("query",), (every_key(s, building) for s in read if "query" in s.kind)),
        _rule("egress", ("reply", "declare_queryable"), (every_key(s, building) for s in read if "query" in s.kind)),
        *_presence_rules(identity, building),
    ]
    return [rule for rule in rules if rule.keys]


def _joined_router_rules(streams: Iterable[Stream], building: str) -> list[Rule]:
    """Between joined routers everything of the building passes: each applies the rules to those who are connected to it."""
    presence = [LIVELINESS.format(building=building, kind="*", id="*"), ROUTER.format(contract="*", release="*")]
    presence.append(INSTANCE.format(building=building, kind="*", id="*", zid="*"))
    keys = [every_key(s, building) for s in streams]
    return [_rule(flow, get_args(Message), keys + presence) for flow in get_args(Flow)]


def _presence_rules(identity: Identity, building: str) -> list[Rule]:
    """An identity announces itself alone; services see everybody."""
    everybody = LIVELINESS.format(building=building, kind="*", id="*")
    rules = []
    if identity.kind in OWNERS["every node"]:
        kind = "camera" if identity.kind == "cameras" else identity.kind
        own = LIVELINESS.format(building=building, kind=kind, id=identity.id or "*")
        instances = INSTANCE.format(building=building, kind=kind, id=identity.id or "*", zid="*")
        rules.append(_rule("ingress", ("liveliness_token",), [own, instances]))
        # It looks which names are taken, and which contract the router speaks.
        looks_at = [own, instances, ROUTER.format(contract="*", release="*")]
        rules.append(_rule("ingress", ("liveliness_query", "declare_liveliness_subscriber"), looks_at))
        rules.append(_rule("egress", ("liveliness_token",), looks_at))
    if identity.kind in _SEE_PRESENCE:
        rules.append(_rule("ingress", ("liveliness_query", "declare_liveliness_subscriber"), [everybody]))
        rules.append(_rule("egress", ("liveliness_token",), [everybody]))
    return rules


def _rule(flow: Flow, messages: tuple[Message, ...], keys: Iterable[str]) -> Rule:
    return Rule(flow, messages, tuple(sorted(set(keys))))


def every_key(stream: Stream, building: str) -> str:
    """A key expression of all keys of a stream in a building."""
    return stream.key_for(building=building)


def own_key(stream: Stream, building: str, identity: Identity) -> str:
    """A key expression of the keys under which an identity publishes and answers.

    A camera may be on any floor. A node of a service may have any id.
    """
    kind = "camera" if identity.kind == "cameras" else identity.kind
    id = identity.id or "*"
    ids = {"building": building, kind: id} if kind in ("camera", "robot") else {"building": building}
    node = f"{kind}-{identity.id}" if identity.id else f"{kind}-$*"  # `$*`: any rest of a name
    ids |= {"node": node, "source": node}
    return f"{ROOT}/" + re.sub(r"{(\w+)}", lambda field: ids.get(field[1], "*"), stream.key)


def access_control(identities: Iterable[Identity], building: str, *, simulation: bool = False) -> dict[str, object]:
    """Zenoh's ``access_control`` for a router: what each of the identities may do, and nobody else anything."""
    rules: list[dict[str, object]] = []
    subjects: list[dict[str, object]] = []
    policies: list[dict[str, object]] = []
    for identity in identities:
        ids = []
        for number, rule in enumerate(rules_of(identity, building, simulation=simulation)):
            ids.append(f"{identity.name}/{number}")
            rules.append(
                {
                    "id": ids[-1],
                    "permission": "allow",
                    "flows": [rule.flow],
                    "messages": list(rule.messages),
                    "key_exprs": list(rule.keys),
                }
            )
        if ids:
            subjects.append({"id": identity.name, "cert_common_names": [identity.name]})
            policies.append({"rules": ids, "subjects": [identity.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
