"""Who may do what on the bus: a row for each stream. A stream without a row fails, so whoever adds one decides who gets it."""

from __future__ import annotations

import json
from itertools import product

import pytest
import zenoh

from surveilnav.contract import INSTANCE, JUDGED, LIVELINESS, ROUTER, SIMULATION, STREAMS, VERSION, Stream
from surveilnav.errors import ConfigError
from surveilnav.security.access import OWNERS, READERS, Rule, access_control, may_own, may_read, own_key, rules_of
from surveilnav.security.identities import KINDS, NAMED, Identity, identity_from_name

#: Stream: who publishes or answers it; who subscribes to it or asks for it. C: cameras.
TABLE = {
    "camera_info": ("C", "fusion gateway recorder supervisor viewer"),
    "camera_frame": ("C", "fusion"),
    "camera_summary": ("C", "planner gateway recorder"),
    "camera_request": ("C", "fusion gateway"),
    "robot_observation": ("robot", "fusion"),
    "robot_status": ("robot", "fusion planner gateway recorder supervisor viewer"),
    "robot_command": ("robot", "planner"),
    "robot_halt": ("robot", "gateway"),
    "passage_state": ("doors", "planner"),
    "floor_areas": ("planner", "gateway"),
    "perception_infer": ("perception", "fusion"),
    "perception_text": ("perception", "fusion planner gateway recorder"),
    "perception_load": ("perception", "fusion planner gateway recorder supervisor viewer"),
    "floor_maps": ("fusion", "planner"),
    "map_layer": ("fusion", "gateway recorder"),
    "map_revision": ("fusion", "planner gateway recorder viewer"),
    "objects": ("fusion", "gateway recorder"),
    "camera_search": ("fusion", "planner gateway"),
    "view_picture": ("fusion", "gateway"),
    "forget_pictures": ("fusion", "gateway"),
    "remove_from_maps": ("fusion", "gateway"),
    "map_removals": ("fusion", "gateway"),
    "view_log": ("fusion", "recorder"),
    "map_snapshot": ("fusion", "recorder"),
    "mission_goal": ("planner", "gateway"),
    "mission_cancel": ("planner", "gateway"),
    "mission_pause": ("planner", "gateway"),
    "mission_status": ("planner", "fusion gateway recorder viewer"),
    "mission_plan": ("planner", "gateway recorder viewer"),
    "traffic": ("C robot perception fusion planner gateway recorder", "gateway recorder viewer"),
    "recorder_status": ("recorder", "gateway viewer"),
    "recordings": ("recorder", "gateway"),
    "recording_read": ("recorder", "gateway"),
    "recording_delete": ("recorder", "gateway"),
    "replay": ("", "gateway"),
    "replay_control": ("", "gateway"),
    "services": ("supervisor", "gateway recorder viewer"),
    "truth": ("C robot", "perception"),
    "judged": ("C robot", "gateway"),
}
#: Streams with pictures of cameras or robots, or with what was drawn from pictures as pictures.
PICTURES = (
    "camera_frame",
    "camera_request",
    "robot_observation",
    "view_picture",
    "view_log",
    "recording_read",
    "map_snapshot",
)


def kinds(text: str) -> set[str]:
    return set(text.replace("C", "camera cameras").split())


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_each_stream_has_its_owners_and_readers(stream):
    assert stream.name in TABLE, (
        f"decide who may publish and who may read {stream.name}, here and in security/access.py"
    )
    owners, readers = TABLE[stream.name]
    assert {kind for kind in KINDS if may_own(kind, stream)} == kinds(owners)
    assert {kind for kind in KINDS if may_read(kind, stream)} == kinds(readers)


def test_the_tables_have_nothing_that_the_contract_lacks():
    assert set(READERS) == set(TABLE) == {stream.name for stream in STREAMS}
    assert set(OWNERS) == {stream.owner for stream in STREAMS}


def test_pictures_are_for_those_that_work_with_them():
    for name in PICTURES:
        assert READERS[name] <= {"fusion", "gateway", "recorder"}
    assert {name for name in READERS if "viewer" in READERS[name]}.isdisjoint(PICTURES)


# --- rules --------------------------------------------------------------------------------------------------------

BUILDING = "b"
#: Whoever the rules must tell apart.
PEOPLE = [Identity(kind) for kind in KINDS if kind not in NAMED] + [
    Identity(kind, id) for kind in ("camera", "robot", "viewer") for id in ("x", "y")
]
#: Those with work of their own; a router passes on what others do.
NODES = [identity for identity in PEOPLE if identity.kind != "router"]


def allows(rules: list[Rule], flow: str, message: str, key: str) -> bool:
    """As Zenoh decides: the message's key lies within a key of a rule."""
    keys = [zenoh.KeyExpr(k) for rule in rules if rule.flow == flow and message in rule.messages for k in rule.keys]
    return any(expression.includes(zenoh.KeyExpr(key)) for expression in keys)


def key(stream: Stream, camera: str = "x", robot: str = "x", node: str = "fusion-fusion") -> str:
    ids = dict.fromkeys(stream.fields, "1") | {
        "building": BUILDING,
        "camera": camera,
        "robot": robot,
        "node": node,
    }
    source = f"robot-{robot}" if stream.name == "judged" else f"camera-{camera}"
    return stream.key_for(**{f: v for f, v in (ids | {"source": source}).items() if f in stream.fields})


@pytest.mark.parametrize("identity", NODES, ids=lambda identity: identity.name)
def test_the_rules_say_what_the_table_says(identity):
    rules = rules_of(identity, BUILDING, simulation=True)
    for stream in STREAMS:
        own = own_key(stream, BUILDING, identity).replace("$*", "1").replace("*", "1")
        every = stream.key_for(building=BUILDING)
        puts, asks = "put" in stream.kind, "query" in stream.kind
        owns = may_own(identity.kind, stream)
        reads = may_read(identity.kind, stream, simulation=True)
        assert allows(rules, "ingress", "put", own) == (owns and puts), stream.name
        assert allows(rules, "ingress", "reply", own) == (owns and asks), stream.name
        assert allows(rules, "ingress", "declare_queryable", own) == (owns and asks), stream.name
        assert allows(rules, "ingress", "declare_subscriber", every) == (reads and puts), stream.name
        assert allows(rules, "egress", "put", every) == (reads and puts), stream.name
        assert allows(rules, "ingress", "query", every) == (reads and asks), stream.name
        assert allows(rules, "egress", "reply", every) == (reads and asks), stream.name


@pytest.mark.parametrize(("kind", "field"), [("camera", "camera"), ("robot", "robot")])
def test_a_camera_and_a_robot_have_only_their_own_keys(kind, field):
    rules = rules_of(Identity(kind, "x"), BUILDING, simulation=True)
    for stream in STREAMS:
        if not may_own(kind, stream) or not {"camera", "robot", "node", "source"} & set(stream.fields):
            continue
        mine = (
            key(stream, camera="x", robot="x", node=f"{kind}-x")
            .replace("camera-x", f"{kind}-x")
            .replace("robot-x", f"{kind}-x")
        )
        others = mine.replace("/x/", "/y/").replace("-x", "-y")
        others = others[:-2] + "/y" if others.endswith("/x") else others
        assert mine != others
        for message in ("put", "reply", "declare_queryable"):
            allowed = allows(rules, "ingress", message, mine)
            assert allowed == (("put" if message == "put" else "query") in stream.kind)
            assert not allows(rules, "ingress", message, others)


@pytest.mark.parametrize("identity", PEOPLE, ids=lambda identity: identity.name)
def test_nobody_may_do_everything(identity):
    for flow, message in product(("ingress", "egress"), ("put", "delete", "query", "reply", "declare_subscriber")):
        rules = rules_of(identity, BUILDING, simulation=True)
        assert not allows(rules, flow, message, "**")
        assert not allows(rules, flow, message, f"surveilnav/1/{BUILDING}/**")
        assert not allows(rules, flow, message, "@/router/config")
        assert not allows(rules, flow, message, "surveilnav/1/other/map_revision/0")


def test_between_joined_routers_everything_of_the_building_passes():
    rules = rules_of(Identity("router"), BUILDING)
    for flow in ("ingress", "egress"):
        for stream in (s for s in STREAMS if s not in SIMULATION):
            for message in ("put", "declare_subscriber", "query", "reply", "declare_queryable"):
                assert allows(rules, flow, message, stream.key_for(building=BUILDING)), (stream.name, message)
        for message in ("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"):
            assert allows(rules, flow, message, LIVELINESS.format(building=BUILDING, kind="camera", id="x"))


def test_outside_simulation_nobody_has_the_truth():
    told = json.dumps(access_control(PEOPLE, BUILDING))
    assert "truth" not in told
    assert "truth" in json.dumps(access_control(PEOPLE, BUILDING, simulation=True))
    assert SIMULATION
    assert not may_read("robot", next(s for s in STREAMS if s.name == "mission_status"))


@pytest.mark.parametrize("identity", NODES, ids=lambda identity: identity.name)
def test_each_announces_itself_alone(identity):
    rules = rules_of(identity, BUILDING)
    said = {
        (kind, id)
        for kind, id in product(("camera", "robot", "planner", "fusion", "gateway", "router", "viewer"), ("x", "y"))
        if allows(rules, "ingress", "liveliness_token", LIVELINESS.format(building=BUILDING, kind=kind, id=id))
    }
    if identity.kind in ("viewer", "supervisor", "recorder", "perception", "doors"):
        expected: set[tuple[str, str]] = set()
    elif identity.kind == "cameras":
        expected = {("camera", "x"), ("camera", "y")}
    elif identity.id:
        expected = {(identity.kind, identity.id)}
    else:
        expected = {(identity.kind, "x"), (identity.kind, "y")}
    assert said == expected


def test_no_key_of_one_stream_is_a_key_of_another():
    """Otherwise who owns one stream could speak on another. Only a camera named "judged" could; no identity has that name."""
    for one, other in product(STREAMS, STREAMS):
        if one is other:
            continue
        mine, theirs = (zenoh.KeyExpr(s.key_for(building=BUILDING)) for s in (one, other))
        if mine.intersects(theirs):
            assert JUDGED in (one, other), f"{one.key} meets {other.key}"
            assert any(s.key.startswith("{building}/{floor}/camera/{camera}/") for s in (one, other))
    with pytest.raises(ConfigError, match="judged"):
        identity_from_name("camera-judged")


def test_the_router_reads_what_is_written():
    rules = access_control(PEOPLE, BUILDING, simulation=True)
    config = zenoh.Config.from_json5(json.dumps({"mode": "router", "access_control": rules}))
    assert json.loads(config.get_json("access_control"))["default_permission"] == "deny"
    assert rules["default_permission"] == "deny"
    ids = [rule["id"] for rule in rules["rules"]]  # type: ignore[index, union-attr]
    assert len(ids) == len(set(ids))


def test_who_announces_itself_may_look_whether_its_name_is_taken_and_no_others():
    for identity in NODES:
        rules = rules_of(identity, BUILDING)
        announces = identity.kind in OWNERS["every node"]
        kind = "camera" if identity.kind == "cameras" else identity.kind
        own = INSTANCE.format(building=BUILDING, kind=kind, id=identity.id or "1", zid="7")
        other = INSTANCE.format(building=BUILDING, kind="robot" if kind == "camera" else "camera", id="z", zid="7")
        for flow, message in (
            ("ingress", "liveliness_token"),
            ("ingress", "liveliness_query"),
            ("egress", "liveliness_token"),
        ):
            assert allows(rules, flow, message, own) == announces, (identity.name, flow, message)
            assert not allows(rules, flow, message, other), (identity.name, flow, message)
        router = ROUTER.format(contract=VERSION + 1, release="9.0.0")
        assert allows(rules, "ingress", "liveliness_query", router) == announces
        assert allows(rules, "egress", "liveliness_token", router) == announces
        assert not allows(rules, "ingress", "liveliness_token", router), "only the router says which contract is spoken"
