"""A bus with certificates and access rules, on a real router over TLS: who isn't let in, and what nobody may do.

The attackers are sessions of Zenoh that keep to no contract. That what they send doesn't arrive can only be seen beside something
that does: so each test also sends what is allowed, and waits for that.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh

from surveilnav import messages as m
from surveilnav.bus import Answer, BusSettings, Node, Unanswered, lease, presence
from surveilnav.bus.connection import encoding_of
from surveilnav.bus.router import free_port, main, open_router
from surveilnav.bus.tls import TlsFiles
from surveilnav.bus.wire import encode
from surveilnav.contract import (
    CAMERA_FRAME,
    CAMERA_REQUEST,
    LIVELINESS,
    MISSION_GOAL,
    ROBOT_COMMAND,
    ROBOT_HALT,
    TRUTH,
)
from surveilnav.errors import BusError, ConfigError
from surveilnav.security.certificates import issue, make_authority
from surveilnav.security.folder import ACCESS, CERTIFICATE, KEY, SecurityFolder
from surveilnav.security.identities import identity_from_name
from tests.waiting import until

NAMES = (
    "router",
    "fusion",
    "planner",
    "gateway",
    "recorder",
    "perception",
    "camera-c1",
    "camera-c2",
    "cameras",
    "robot-r1",
    "viewer-a",
)
HOSTS = ("localhost", "127.0.0.1", "::1")
#: How long something that mustn't arrive is waited for, after something else has [s].
SOON_S = 0.3


def files_in(folder: Path) -> TlsFiles:
    return TlsFiles(folder / "ca.pem", folder / CERTIFICATE, folder / KEY)


def settings(router: str, files: TlsFiles, timeout_s: float = 20.0) -> BusSettings:
    return BusSettings(
        router=router,
        building="test",
        connect_timeout_s=timeout_s,
        tls_ca=files.ca,
        tls_certificate=files.certificate,
        tls_key=files.key,
    )


def make_folder(path: Path, **more: object) -> SecurityFolder:
    return SecurityFolder.create(path, "test", [identity_from_name(name) for name in NAMES], HOSTS, **more)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> SecurityFolder:
    return make_folder(tmp_path_factory.mktemp("security") / "building")


@pytest.fixture(scope="module")
def router(folder: SecurityFolder) -> Iterator[str]:
    listen = f"tls/127.0.0.1:{free_port()}"
    with open_router(listen, files_in(folder.identity_folder("router")), folder.path / ACCESS):
        yield listen


@pytest.fixture(scope="module")
def bus(folder: SecurityFolder, router: str) -> Callable[[str], BusSettings]:
    """``bus(name)``: how the owner of an identity reaches the bus."""
    return lambda name: settings(router, files_in(folder.identity_folder(name)))


@pytest.fixture
def attacker(bus: Callable[[str], BusSettings]) -> Iterator[Callable[[str], zenoh.Session]]:
    """``attacker(name)``: a session with an identity's files that does whatever it likes."""
    opened = []

    def start(name: str) -> zenoh.Session:
        opened.append(zenoh.open(zenoh.Config.from_json5(bus(name).client_config())))
        return opened[-1]

    yield start
    for session in opened:
        session.close()


# --- who isn't let in ---------------------------------------------------------------------------------------------


def test_a_certificate_of_another_authority_is_refused(router, tmp_path):
    stranger = make_folder(tmp_path / "rogue").identity_folder("fusion")
    with (
        pytest.raises(BusError, match="its certificate isn't right for"),
        Node("fusion", "fusion", settings(router, files_in(stranger), 1.0)),
    ):
        pass


def test_a_rogue_certificate_with_the_right_authority_file_is_refused(router, folder, tmp_path):
    """The attacker knows ca.pem, which is no secret, and so believes the router; the router doesn't believe the attacker."""
    rogue = make_folder(tmp_path / "rogue").identity_folder("fusion")
    files = TlsFiles(folder.path / "ca.pem", rogue / CERTIFICATE, rogue / KEY)
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(settings(router, files, 1.0).client_config()))
    assert "refuses this process's certificate" in files.explain("127.0.0.1", int(router.rpartition(":")[2]))


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_nobody_comes_in_without_a_certificate(router, folder, protocol):
    endpoint = router.replace("tls/", f"{protocol}/")
    config = zenoh.Config.from_json5(
        BusSettings(router=endpoint.replace("tls/", "tcp/"), connect_timeout_s=1).client_config()
    )
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("transport/link/tls", f'{{"root_ca_certificate": "{folder.path / "ca.pem"}"}}')
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_replicas_with_one_certificate_for_all_cameras_take_one_each(bus, monkeypatch):
    monkeypatch.setattr(lease.zlib, "crc32", lambda _: 0)  # all of them begin at the first
    with (
        lease.lease_slot("camera", ["c8", "c9"], bus("cameras")) as one,
        lease.lease_slot("camera", ["c8", "c9"], bus("cameras")) as other,
    ):
        assert {one[0], other[0]} == {"c8", "c9"}
        with lease.lease_slot("camera", ["c8", "c9"], bus("cameras"), wait_s=0.5) as third:
            assert third is None


def test_nobody_joins_anothers_session(bus, attacker):
    """A session may have several links. One with the planner's session id, but a camera's certificate, isn't added to it."""
    planner = attacker("planner")
    config = zenoh.Config.from_json5(bus("camera-c1").model_copy(update={"connect_timeout_s": 1}).client_config())
    config.insert_json5("id", json.dumps(str(planner.info.zid())))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_an_unencrypted_bus_isnt_taken_for_an_encrypted_one(folder):
    listen = f"tcp/127.0.0.1:{free_port()}"
    bus = settings(listen.replace("tcp/", "tls/"), files_in(folder.identity_folder("fusion")), 1.0)
    with open_router(listen), pytest.raises(BusError, match="without an identity"), Node("fusion", "fusion", bus):
        pass


def test_a_camera_is_no_router(folder, tmp_path):
    """Its certificate is good for clients alone: who has stolen it can't have others connect to it."""
    listen = f"tls/127.0.0.1:{free_port()}"
    camera = files_in(folder.identity_folder("camera-c1"))
    with pytest.raises(ConfigError, match="certificate is for 'camera-c1', not for 'router'"):
        open_router(listen, camera, folder.path / ACCESS)


# --- what nobody may do -------------------------------------------------------------------------------------------


def test_a_camera_cant_speak_for_another(bus, attacker):
    heard: list[str] = []
    every = CAMERA_FRAME.key_for(building="test")
    subscriber = attacker("fusion").declare_subscriber(every, lambda sample: heard.append(str(sample.key_expr)))
    session = attacker("camera-c1")
    own = CAMERA_FRAME.key_for(building="test", floor="0", camera="c1", view=0)
    spoofed = CAMERA_FRAME.key_for(building="test", floor="0", camera="c2", view=0)

    def both() -> bool:
        session.put(spoofed, b"a picture")
        session.put(own, b"a picture")
        return own in heard

    until(both, lambda: heard)
    time.sleep(SOON_S)
    assert set(heard) == {own}
    subscriber.undeclare()


def test_a_camera_cant_answer_for_another(bus, attacker):
    session = attacker("camera-c1")
    asked: list[str] = []

    def answer(query: zenoh.Query) -> None:
        asked.append(str(query.key_expr))
        query.reply(str(query.key_expr), b"", attachment=encode(m.Ack(stamp_ns=1)), encoding=encoding_of(m.Ack))
        query.drop()

    keys = [CAMERA_REQUEST.key_for(building="test", floor="0", camera=camera) for camera in ("c1", "c2")]
    declared = [session.declare_queryable(key, answer) for key in keys]
    request = m.CameraRequest(stamp_ns=1, action="resend", views=[0])
    with Node("fusion", "fusion", bus("fusion")) as fusion:
        until(lambda: _answers(fusion, CAMERA_REQUEST, request, floor="0", camera="c1"))
        assert not _answers(fusion, CAMERA_REQUEST, request, floor="0", camera="c2")
    assert set(asked) == {keys[0]}
    assert len(declared) == 2


def test_a_camera_isnt_present_as_another(bus, attacker):
    with Node("fusion", "fusion", bus("fusion")) as fusion:
        fusion.alive("camera")
        session = attacker("camera-c1")
        tokens = [
            session.liveliness().declare_token(LIVELINESS.format(building="test", kind=kind, id=id))
            for kind, id in (("camera", "c2"), ("planner", "planner"), ("camera", "c1"))
        ]
        until(lambda: "c1" in fusion.alive("camera"))
        time.sleep(SOON_S)
        assert fusion.alive("camera") == {"c1"}
        assert fusion.alive("planner") == set()
        del tokens


@pytest.mark.parametrize("thief", ["camera-c1", "robot-r1", "gateway", "fusion", "viewer-a"])
def test_nobody_but_the_planner_commands_a_robot(bus, attacker, thief):
    commands: list[object] = []

    def obey(request):
        commands.append(request)
        return Answer(m.CommandReply(stamp_ns=1, accepted=True, seq=1))

    with Node("robot", "r1", bus("robot-r1")) as robot, Node("planner", "planner", bus("planner")) as planner:
        robot.serve(ROBOT_COMMAND, obey, robot="r1")
        command = m.Command(stamp_ns=1, action="stop", seq_expected=0)
        until(lambda: _answers(planner, ROBOT_COMMAND, command, robot="r1"))
        commands.clear()
        session = attacker(thief)
        key = ROBOT_COMMAND.key_for(building="test", robot="r1")
        replies = list(session.get(key, payload=encode(command), encoding=encoding_of(m.Command), timeout=1.0))
        assert not [reply for reply in replies if reply.ok]
        assert _answers(planner, ROBOT_COMMAND, command, robot="r1")
        assert len(commands) == 1


@pytest.mark.parametrize("curious", ["viewer-a", "camera-c2", "gateway", "planner", "robot-r1", "recorder"])
def test_nobody_but_fusion_gets_frames(bus, attacker, curious):
    session = attacker(curious)
    peeked: list[str] = []
    for pattern in (
        "**",
        "surveilnav/**",
        "surveilnav/1/test/*/camera/*/frame/*",
        "surveilnav/1/test/robot/*/observation",
    ):
        session.declare_subscriber(pattern, lambda sample: peeked.append(str(sample.key_expr)))
    with Node("camera", "c1", bus("camera-c1")) as camera:
        frames = camera.publisher(CAMERA_FRAME, floor="0", camera="c1", view=0)
        time.sleep(SOON_S)
        assert not frames.matched  # nobody listens, so the camera wouldn't even render
        with Node("fusion", "fusion", bus("fusion")) as fusion:
            slot = fusion.latest(CAMERA_FRAME, floor="0", camera="c1", view=0)
            until(lambda: frames.matched)
            frames._publisher.put(b"picture")
            until(lambda: slot._sample is not None)
    time.sleep(SOON_S)
    assert not peeked


@pytest.mark.parametrize("name", ["perception", "camera-c1", "gateway"])
def test_the_truth_channel_isnt_there_outside_simulation(bus, attacker, name):
    told: list[str] = []
    key = TRUTH.key_for(building="test", source="camera-c1", view=0)
    attacker("perception").declare_subscriber(key, lambda sample: told.append(str(sample.key_expr)))
    publisher = attacker(name).declare_publisher(key)
    time.sleep(SOON_S)
    assert not publisher.matching_status.matching
    publisher.put(b"labels")
    attacker(name).declare_queryable(key, lambda query: told.append(str(query.key_expr)))
    time.sleep(SOON_S)
    assert not list(attacker("perception").get(key, timeout=1.0))
    assert not told


def test_a_camera_cant_start_a_mission_or_stop_robots(bus, attacker):
    calls: list[str] = []
    with Node("planner", "planner", bus("planner")) as planner, Node("robot", "r1", bus("robot-r1")) as robot:
        planner.serve(
            MISSION_GOAL,
            lambda request: (
                calls.append("goal") or Answer(m.MissionAck(stamp_ns=1, mission="m1", accepted=True, state="active"))
            ),
        )
        robot.serve(
            ROBOT_HALT,
            lambda request: calls.append("halt") or Answer(m.HaltReply(stamp_ns=1, robot="r1", halted=True)),
            robot="r1",
        )
        goal = m.MissionGoal(stamp_ns=1, mission="m1", target="tv")
        halt = m.Halt(stamp_ns=1, halted=True)
        session = attacker("camera-c1")
        for stream, message, ids in ((MISSION_GOAL, goal, {"mission": "m1"}), (ROBOT_HALT, halt, {})):
            key = stream.key_for(building="test", **ids)
            replies = session.get(key, payload=encode(message), encoding=encoding_of(type(message)), timeout=1.0)
            assert not [reply for reply in replies if reply.ok]
        assert calls == []
        with Node("gateway", "gateway", bus("gateway")) as gateway:
            until(lambda: _answers(gateway, MISSION_GOAL, goal, mission="m1"))
            assert gateway.ask_all(ROBOT_HALT, halt)
    assert set(calls) == {"goal", "halt"}


def test_the_routers_own_state_isnt_shown(attacker):
    session = attacker("gateway")
    (router,) = session.info.routers_zid()
    told = [str(reply.ok.key_expr) for reply in session.get("@/**", timeout=1.0) if reply.ok]
    assert not [key for key in told if str(router) in key.split("/")[1]]


def test_an_identity_that_was_removed_may_do_nothing(tmp_path):
    folder = make_folder(tmp_path / "building")
    kept = tmp_path / "stolen"
    kept.mkdir()
    for file in folder.identity_folder("camera-c1").iterdir():
        (kept / file.name).write_bytes(file.read_bytes())
        (kept / file.name).chmod(0o600)
    folder.remove("camera-c1")
    listen = f"tls/127.0.0.1:{free_port()}"
    with (
        open_router(listen, files_in(folder.identity_folder("router")), folder.path / ACCESS),
        Node("fusion", "fusion", settings(listen, files_in(folder.identity_folder("fusion")))) as fusion,
        Node("camera", "c1", settings(listen, files_in(kept))) as camera,
    ):
        frames = camera.publisher(CAMERA_FRAME, floor="0", camera="c1", view=0)
        fusion.latest(CAMERA_FRAME, floor="0", camera="c1", view=0)
        time.sleep(SOON_S)
        assert not frames.matched
        assert fusion.alive("camera") == set()


def _answers(node: Node, stream, request, **ids) -> bool:
    try:
        node.ask(stream, request, timeout_s=2.0, **ids)
    except Unanswered:
        return False
    return True


# --- files that are wrong -----------------------------------------------------------------------------------------


def reissued(folder: SecurityFolder, name: str, path: Path, now: datetime, valid: timedelta) -> TlsFiles:
    """Files of an identity with other times."""
    pair = issue(folder._authority(), name, now, valid)
    path.mkdir()
    (path / "ca.pem").write_bytes((folder.path / "ca.pem").read_bytes())
    (path / CERTIFICATE).write_bytes(pair.certificate_pem)
    (path / KEY).write_bytes(pair.key_pem)
    (path / KEY).chmod(0o600)
    return files_in(path)


@pytest.mark.parametrize(
    ("days", "said"), [(-500, "expired at"), (2, "is valid only from .* is this machine's clock right")]
)
def test_times_are_named(router, folder, tmp_path, days, said):
    files = reissued(folder, "fusion", tmp_path / "id", datetime.now(UTC) + timedelta(days=days), timedelta(days=30))
    with pytest.raises(ConfigError, match=said), Node("fusion", "fusion", settings(router, files, 1.0)):
        pass


@pytest.mark.parametrize("days", [-9, 2])
def test_the_router_itself_refuses_what_has_expired_or_isnt_valid_yet(router, folder, tmp_path, days):
    """Whatever the client thinks of it."""
    files = reissued(folder, "fusion", tmp_path / "id", datetime.now(UTC) + timedelta(days=days), timedelta(days=1))
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(settings(router, files, 1.0).client_config()))


def test_a_link_ends_when_its_certificate_expires(router, folder, tmp_path):
    files = reissued(folder, "fusion", tmp_path / "id", datetime.now(UTC), timedelta(seconds=3))
    with Node("fusion", "fusion", settings(router, files, 5.0)) as node:
        assert node.routers() == 1
        until(lambda: node.routers() == 0, timeout_s=20)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda files: files.key.chmod(0o644), "open to others .mode 0644.: chmod 600"),
        (
            lambda files: files.key.write_text("-----BEGIN PRIVATE KEY-----\nc2VjcmV0\n-----END PRIVATE KEY-----\n"),
            "none that can",
        ),
        (lambda files: files.key.unlink(), "can't be read: No such file"),
        (lambda files: files.certificate.write_text("nonsense"), "expected a certificate in PEM format"),
        (lambda files: files.ca.unlink(), "can't be read: No such file"),
        (
            lambda files: files.ca.write_bytes(make_authority("x", datetime.now(UTC), timedelta(1)).certificate_pem),
            "isn't issued by",
        ),
    ],
)
def test_faults_of_files_are_named_without_secrets(router, folder, tmp_path, spoil, said):
    files = reissued(folder, "fusion", tmp_path / "id", datetime.now(UTC), timedelta(days=1))
    secret = files.key.read_text().splitlines()[1]
    spoil(files)
    with pytest.raises(ConfigError, match=said) as caught, Node("fusion", "fusion", settings(router, files, 1.0)):
        pass
    assert secret not in str(caught.value)
    assert "c2VjcmV0" not in str(caught.value)


def test_a_key_of_another_identity_is_named(router, folder, tmp_path):
    files = reissued(folder, "fusion", tmp_path / "id", datetime.now(UTC), timedelta(days=1))
    mixed = TlsFiles(files.ca, files.certificate, folder.identity_folder("planner") / KEY)
    with (
        pytest.raises(ConfigError, match="doesn't belong to the certificate"),
        Node("f", "f", settings(router, mixed, 1.0)),
    ):
        pass


def test_a_node_with_anothers_identity_says_so(bus):
    with (
        pytest.raises(BusError, match=r"is the camera 'c2', but its certificate is for 'camera-c1'.*camera-c2"),
        Node("camera", "c2", bus("camera-c1")),
    ):
        pass


def test_of_two_nodes_with_one_identity_the_second_is_refused_by_name(bus, monkeypatch):
    monkeypatch.setattr(presence, "NAME_WAIT_S", 0.5)
    with Node("camera", "c1", bus("camera-c1")) as first, Node("fusion", "fusion", bus("fusion")) as fusion:
        until(lambda: fusion.alive("camera") == {"c1"})
        with pytest.raises(BusError, match="a camera named 'c1' is on the bus already"):
            Node("camera", "c1", bus("camera-c1")).__enter__()
        assert (first.routers(), fusion.alive("camera")) == (1, {"c1"}), "harmless to the first"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"router": "tls/127.0.0.1:1"}, "needs SURVEILNAV_BUS__TLS_CA"),
        ({"router": "tcp/127.0.0.1:1", "tls_key": Path("key.pem")}, "isn't encrypted"),
    ],
)
def test_half_an_identity_is_refused(more, said):
    with pytest.raises(ValueError, match=said):
        BusSettings(**more)


# --- the router ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "aren't JSON"),
        ("{}", "enabled and deny by default"),
        ('{"enabled": true, "default_permission": "allow"}', "deny by default"),
        (None, "can't be read"),
        ("[" * 100_000, "aren't JSON"),
        ('{"enabled": true, "default_permission": "deny", "rules": 5}', "Zenoh can't read the access rules"),
        ('{"enabled": true, "default_permission": "deny", "nonsense": []}', "Zenoh can't read the access rules"),
    ],
)
def test_rules_that_arent_right_are_named(folder, tmp_path, text, said):
    if text is not None:
        (tmp_path / "access.json").write_text(text)
    with pytest.raises(ConfigError, match=said):
        open_router(
            f"tls/127.0.0.1:{free_port()}", files_in(folder.identity_folder("router")), tmp_path / "access.json"
        )


def test_a_router_has_both_or_neither(folder):
    files = files_in(folder.identity_folder("router"))
    for listen, own, access in (
        ("tls/127.0.0.1:1", files, None),
        ("tls/127.0.0.1:1", None, folder.path / ACCESS),
        ("tcp/127.0.0.1:1", files, None),
        ("tcp/127.0.0.1:1", None, folder.path / ACCESS),
    ):
        with pytest.raises(ConfigError):
            open_router(listen, own, access)


def test_the_routers_process_says_what_is_wrong_in_one_line(capsys, monkeypatch):
    monkeypatch.delenv("SURVEILNAV_BUS__TLS_CA", raising=False)
    assert main(["--listen", "tls/127.0.0.1:1"]) == 1
    said = capsys.readouterr().err
    assert "SURVEILNAV_BUS__TLS_CA" in said
    assert "Traceback" not in said
