"""A gateway that answers only with a key: who gets in, who may do what, and what the log says of it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
import structlog
from structlog.testing import capture_logs

from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.security.api_keys import ApiKey, ApiKeysFile
from surveilnav.security.roles import Role
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core.attempts import MAX_FAILURES, WINDOW_S, FailedAttempts
from surveilnav.services.gateway.service import Gateway
from tests.waiting import until


class Keys:
    """The gateway's file of keys, and the key of each role."""

    def __init__(self, path: Path) -> None:
        self.file = ApiKeysFile(path)
        self.of = {role.name: self.file.add(role.name, role) for role in Role}


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Keys:
    return Keys(tmp_path_factory.mktemp("keys") / "keys.json")


@pytest.fixture(scope="module")
def authentication(keys: Keys) -> Authentication:
    return Authentication(keys.file.path)


@pytest.fixture(scope="module")
def guarded(router, building, client, authentication, start_gateway) -> Iterator[tuple[str, Gateway]]:
    with ExitStack() as stack:
        yield start_gateway(router, stack, authentication=authentication)


@pytest.fixture
def as_(guarded, keys) -> Iterator[Callable[[str | None], httpx.Client]]:
    """``as_(role)``: a client with the key of a role; None: without any."""
    with ExitStack() as stack:

        def open_client(role: str | None) -> httpx.Client:
            headers = {"Authorization": f"Bearer {keys.of.get(role, role)}"} if role else {}
            return stack.enter_context(httpx.Client(base_url=guarded[0], headers=headers, timeout=20))

        yield open_client


@pytest.fixture(autouse=True)
def _forgiven(authentication: Authentication) -> Iterator[None]:
    """All tests come from one address: the failures of one mustn't count in the next."""
    yield
    authentication._failed = FailedAttempts()


def problem(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["type"].rpartition(":")[2]


# --- who gets in --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        "/api/v1/missions",
        "/api/v1/cameras/c1/latest.jpg",
        "/api/v1/live",
        "/metrics",
        "/openapi.json",
        "/docs",
        "/nowhere",
    ],
)
def test_without_a_key_nothing_of_the_building_is_shown(as_, path):
    answer = as_(None).get(path)
    assert problem(answer) == (401, "key_needed")
    assert answer.headers["www-authenticate"].startswith("Bearer")


def test_the_page_and_the_pulse_are_for_everybody(as_):
    stranger = as_(None)
    page = stranger.get("/")
    assert page.status_code == 200
    script = re.search(r'src="(static/[^"]+)"', page.text)
    assert script
    assert stranger.get(f"/{script[1]}").status_code == 200
    assert stranger.get("/healthz").json() == {"status": "ok"}
    assert stranger.get("/api/v1/session").json() == {"needed": True, "name": "", "role": None}


@pytest.mark.parametrize(
    "header",
    [
        "Bearer",
        "Basic YWRtaW46YWRtaW4=",
        "Bearer snav_00000000_" + "a" * 43,
        "Bearer " + "x" * 5000,
        "Bearer \xff",
    ],
)
def test_a_wrong_key_is_refused(as_, header):
    answer = as_(None).get("/api/v1/missions", headers=[(b"Authorization", header.encode("latin-1"))])
    assert answer.status_code == 401


def test_a_right_id_with_a_wrong_secret_is_refused(as_, keys):
    right = keys.of["admin"]
    wrong = right[:-2] + ("AA" if not right.endswith("AA") else "BB")
    assert problem(as_(wrong).get("/api/v1/missions")) == (401, "wrong_key")


def test_a_revoked_key_is_refused_at_once(as_, keys):
    keys.of["guest"] = keys.file.add("guest", Role.viewer)
    guest = as_("guest")
    assert guest.get("/api/v1/missions").status_code == 200
    keys.file.revoke("guest")
    assert problem(guest.get("/api/v1/missions")) == (401, "wrong_key")
    assert as_("viewer").get("/api/v1/missions").status_code == 200


@pytest.mark.parametrize("path", ["/api/v1/live", "/api/v1/tiles?of=c1/3"])
@pytest.mark.parametrize("by_session", [False, True])
def test_an_open_stream_ends_when_its_key_is_revoked(as_, keys, path, by_session):
    key = keys.of["watcher"] = keys.file.add("watcher", Role.viewer)
    client = as_(None if by_session else "watcher")
    if by_session:
        client.post("/api/v1/session", json={"key": key})
    with client.stream("GET", path) as stream:
        pieces = stream.iter_bytes()
        next(pieces)
        keys.file.add("somebody", Role.viewer)  # another change of the file ends nothing
        next(pieces)
        keys.file.revoke("watcher")
        with pytest.raises(httpx.RemoteProtocolError):
            list(pieces)
    keys.file.revoke("somebody")


def test_a_file_that_cant_be_read_lets_nobody_in(as_, keys):
    viewer = as_("viewer")
    assert viewer.get("/api/v1/missions").status_code == 200
    whole = keys.file.path.read_text()
    keys.file.path.write_text("{")
    try:
        assert problem(viewer.get("/api/v1/missions")) == (503, "keys_unreadable")
    finally:
        keys.file.path.write_text(whole)
    assert viewer.get("/api/v1/missions").status_code == 200


def test_a_key_is_compared_with_its_hash_once(as_, keys, monkeypatch):
    """argon2 takes 20 ms on purpose; after that a request costs a digest."""
    compared: list[str] = []
    matches = ApiKey.matches
    monkeypatch.setattr(ApiKey, "matches", lambda key, secret: compared.append(key.name) or matches(key, secret))
    keys.of["often"] = keys.file.add("often", Role.viewer)
    client = as_("often")
    for _ in range(20):
        assert client.get("/api/v1/missions").status_code == 200
    assert compared == ["often"]
    keys.file.revoke("often")


def test_many_wrong_keys_are_refused_for_a_while_but_not_who_is_known(as_, keys):
    viewer = as_("viewer")
    assert viewer.get("/api/v1/missions").status_code == 200
    for _ in range(MAX_FAILURES):
        assert as_("snav_00000000_" + "a" * 43).get("/api/v1/missions").status_code == 401
    refused = as_("snav_00000000_" + "a" * 43).get("/api/v1/missions")
    assert problem(refused) == (429, "too_many_wrong_keys")
    assert 0 < int(refused.headers["retry-after"]) <= WINDOW_S + 1
    signed_in = as_(None).post("/api/v1/session", json={"key": "snav_00000000_" + "a" * 43})
    assert problem(signed_in) == (429, "too_many_wrong_keys")
    assert viewer.get("/api/v1/missions").status_code == 200


def test_failures_are_counted_by_client():
    attempts = FailedAttempts()
    for i in range(MAX_FAILURES):
        attempts.record_failure("10.0.0.1", float(i))
        attempts.record_failure(f"2001:db8::{i:x}", float(i))  # one client has many of these addresses
    assert attempts.wait_s("10.0.0.1", 10.0) == WINDOW_S - 10.0
    assert attempts.wait_s("10.0.0.1", WINDOW_S + 1) == 0.0
    assert attempts.wait_s("2001:db8::ffff", 10.0) > 0
    assert attempts.wait_s("10.0.0.2", 10.0) == 0.0
    assert attempts.wait_s("2001:db8:1::1", 10.0) == 0.0


# --- who may do what ----------------------------------------------------------------------------------------------

GOAL = ("POST", "/api/v1/missions", {"target": "tv"})
REQUESTS = [
    (("GET", "/api/v1/missions", None), "viewer"),
    (("GET", "/api/v1/cameras/c1/views/3.jpg", None), "viewer"),
    (("GET", "/metrics", None), "viewer"),
    (GOAL, "operator"),
    (("POST", "/api/v1/robots/stop", {}), "operator"),
    (("POST", "/api/v1/robots/release", {}), "operator"),
    (("POST", "/api/v1/cameras/c1/pause", None), "admin"),
    (("POST", "/api/v1/cameras/c1/resume", None), "admin"),
    (("DELETE", "/api/v1/pictures", None), "admin"),
    (("GET", "/api/v1/cameras/c1/looks", None), "admin"),
]


@pytest.mark.parametrize("role", ["viewer", "operator", "admin"])
@pytest.mark.parametrize(("request_", "needed"), REQUESTS)
def test_each_role_does_what_it_may(as_, building, request_, needed, role):
    method, path, body = request_
    before = len(building.goals)
    answer = as_(role).request(method, path, json=body)
    if Role[role] >= Role[needed]:
        assert answer.status_code < 300, answer.text
    else:
        assert problem(answer) == (403, "role")
        assert needed in answer.json()["detail"]
        assert len(building.goals) == before


def test_a_role_is_as_the_file_says_now(as_, keys):
    keys.of["temp"] = keys.file.add("temp", Role.admin)
    client = as_("temp")
    assert client.get("/api/v1/cameras/c1/looks").status_code == 200
    keys.file.path.write_text(
        keys.file.path.read_text().replace(
            '"name": "temp",\n   "role": "admin"', '"name": "temp",\n   "role": "viewer"'
        )
    )
    assert {key.name: key.role for key in keys.file.read()}["temp"] is Role.viewer
    assert problem(client.get("/api/v1/cameras/c1/looks")) == (403, "role")
    keys.file.revoke("temp")


def test_a_foreign_host_is_refused_before_any_key_is_looked_at(as_):
    answer = as_("admin").get("/api/v1/missions", headers={"Host": "evil.example"})
    assert problem(answer) == (421, "foreign_host")


# --- sessions -----------------------------------------------------------------------------------------------------


def test_a_page_has_a_session_for_its_key(as_, keys):
    browser = as_(None)
    signed = browser.post("/api/v1/session", json={"key": keys.of["operator"]})
    assert signed.json() == {"needed": True, "name": "operator", "role": "operator"}
    cookie = signed.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    assert "Path=/" in cookie
    assert "Secure" not in cookie
    assert keys.of["operator"] not in cookie
    assert browser.get("/api/v1/session").json()["name"] == "operator"
    with browser.stream("GET", "/api/v1/live") as stream:  # an EventSource sends cookies alone
        assert stream.status_code == 200
    assert browser.get("/api/v1/cameras/c1/latest.jpg").status_code == 200
    assert browser.request(*GOAL[:2], json=GOAL[2]).status_code == 202
    assert problem(browser.delete("/api/v1/pictures")) == (403, "role")
    assert browser.delete("/api/v1/session").status_code == 204
    assert browser.get("/api/v1/missions").status_code == 401


def test_the_cookie_of_an_ended_session_is_worth_nothing(as_, keys):
    browser = as_(None)
    browser.post("/api/v1/session", json={"key": keys.of["viewer"]})
    stolen = dict(browser.cookies)
    browser.delete("/api/v1/session")
    thief = as_(None)
    thief.cookies.update(stolen)
    assert problem(thief.get("/api/v1/missions")) == (401, "session_ended")


def test_a_session_ends_with_its_key(as_, keys):
    browser = as_(None)
    assert browser.post("/api/v1/session", json={"key": keys.file.add("brief", Role.viewer)}).status_code == 200
    assert browser.get("/api/v1/missions").status_code == 200
    keys.file.revoke("brief")
    assert problem(browser.get("/api/v1/missions")) == (401, "session_ended")


def test_a_session_ends_by_itself(as_, keys, monkeypatch):
    monkeypatch.setattr("surveilnav.services.gateway.authentication.SESSION_S", -1.0)
    browser = as_(None)
    browser.post("/api/v1/session", json={"key": keys.of["viewer"]})
    assert browser.get("/api/v1/missions").status_code == 401


def test_another_sites_page_cant_use_a_session(as_, keys):
    browser = as_(None)
    browser.post("/api/v1/session", json={"key": keys.of["operator"]})
    answer = browser.request(*GOAL[:2], json=GOAL[2], headers={"Origin": "https://evil.example"})
    assert problem(answer) == (403, "foreign_page")


def test_behind_a_proxy_that_encrypts_the_cookie_is_for_encrypted_pages(as_, keys):
    answer = as_(None).post("/api/v1/session", json={"key": keys.of["viewer"]}, headers={"Origin": "https://localhost"})
    assert "Secure" in answer.headers["set-cookie"]


def test_a_gateway_without_keys_says_so(client):
    assert client.get("/api/v1/session").json() == {"needed": False, "name": "", "role": None}
    assert problem(client.post("/api/v1/session", json={"key": "x"})) == (409, "no_keys")
    assert client.delete("/api/v1/session").status_code == 204


# --- what is logged -----------------------------------------------------------------------------------------------


def test_the_log_says_who_commanded_what_and_has_no_key(as_, keys):
    structlog.reset_defaults()
    with capture_logs() as lines:
        operator = as_("operator")
        operator.request(*GOAL[:2], json=GOAL[2])

        def refused() -> bool:  # logged at a limited rate
            operator.delete("/api/v1/pictures")
            return any(line["event"] == "refused" for line in lines)

        until(refused)
        as_("snav_0000beef_" + "a" * 43).get("/api/v1/missions")
        as_(None).post("/api/v1/session", json={"key": keys.of["viewer"]})
        until(lambda: any(line["event"] == "signed in" for line in lines))
    commanded = [line for line in lines if line["event"] == "commanded"]
    assert commanded[0]["key"] == "operator"
    assert (commanded[0]["method"], commanded[0]["path"], commanded[0]["status"]) == ("POST", "/api/v1/missions", 202)
    assert commanded[0]["client"] == "127.0.0.1"
    events = {line["event"] for line in lines}
    assert {"commanded", "refused", "a wrong key", "signed in"} <= events
    told = json.dumps(lines, default=str)
    for secret in [*(key.split("_", 2)[2] for key in keys.of.values()), "a" * 43]:
        assert secret not in told


def test_the_access_log_has_the_name_of_the_key(as_):
    assert as_("viewer").get("/api/v1/cameras/c1/views/5.jpg").status_code == 200
    looks = as_("admin").get("/api/v1/cameras/c1/looks").json()["items"]
    assert ("viewer", 5) in {(look["key"], look["view"]) for look in looks}


def test_answers_have_headers_that_protect_browsers(as_):
    for path in ("/healthz", "/api/v1/missions", "/"):
        headers = as_(None).get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "no-referrer"
        assert "default-src 'none'" in headers["content-security-policy"]
    assert as_("viewer").get("/api/v1/missions").headers["cache-control"] == "no-store"


def test_a_long_body_is_refused(as_):
    answer = as_("admin").post("/api/v1/missions", content=b"x" * 70_000)
    assert problem(answer) == (413, "too_large")


# --- settings and client ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "more", "needed"),
    [
        ("127.0.0.1", {}, False),
        ("localhost", {}, False),
        ("::1", {}, False),
        ("127.0.0.1", {"keys_file": "keys.json"}, True),
        ("127.0.0.1", {"authentication": "keys"}, True),
        ("0.0.0.0", {}, True),
        ("", {}, True),
        ("::", {}, True),
        ("192.168.1.4", {}, True),
        ("gateway.example", {}, True),
        ("0.0.0.0", {"authentication": "none"}, False),
    ],
)
def test_beyond_loopback_keys_are_needed(host, more, needed):
    assert GatewaySettings(host=host, **more).needs_keys is needed


def test_without_a_file_of_keys_nobody_gets_in():
    with pytest.raises(Exception, match="isn't known here"):
        Authentication(None).key_owner("snav_00000000_" + "a" * 43, "10.0.0.1")
    assert Authentication(None).session_owner("x") is None


def test_the_client_sends_the_key_of_the_environment(guarded, keys, monkeypatch):
    with Client(guarded[0]) as building, pytest.raises(GatewayError) as refused:
        building.missions()
    assert refused.value.name == "key_needed"
    assert "SURVEILNAV_API_KEY" in str(refused.value)
    monkeypatch.setenv("SURVEILNAV_API_KEY", keys.of["viewer"])
    with Client(guarded[0]) as building:
        building.missions()
    with Client(guarded[0], api_key=keys.of["operator"]) as building:
        assert building.submit("tv").id
