"""``/live`` and ``/tiles`` over a real bus and a real socket, and what the page is made of."""

from __future__ import annotations

import base64
import json
import random
import re
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import MagicMock

import httpx
import msgspec
import pytest

from surveilnav import contract, rest
from surveilnav.bus import Node, clock_ns
from surveilnav.services.gateway import tiles
from surveilnav.services.gateway.service import Gateway
from surveilnav.services.gateway.stream_sources import LiveStates
from surveilnav.services.gateway.tiles import CameraTiles
from tests.services.gateway.streams import blocks, within
from tests.waiting import until


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    """A stream says something every half second: a watcher that shall end hears it."""
    monkeypatch.setattr(LiveStates, "beat_s", 0.5)
    monkeypatch.setattr(CameraTiles, "beat_s", 0.5)


class Watcher:
    """A client of a stream of states, on a thread: what it knows of everything, and what it was told."""

    def __init__(self) -> None:
        self.known: dict[tuple[str, str], Any] = {}
        self.told: list[str] = []
        self.ended = False

    def read(self, lines: Iterator[str]) -> None:
        kind = ""
        for line in lines:
            if line.startswith("event: "):
                kind = line.removeprefix("event: ")
                self.told.append(kind)
            elif line.startswith("data: ") and kind not in ("reset", "beat"):
                row = json.loads(line.removeprefix("data: "))
                self.known[kind, row["id"]] = row["state"]
            if self.ended:
                return


@contextmanager
def watching(client: httpx.Client, path: str) -> Iterator[Watcher]:
    watcher = Watcher()
    with client.stream("GET", path) as answer:
        assert answer.status_code == 200, answer.read()
        thread = threading.Thread(target=lambda: _read(watcher, answer), daemon=True)
        thread.start()
        yield watcher
        watcher.ended = True
        thread.join(10)


def _read(watcher: Watcher, answer: httpx.Response) -> None:
    try:
        watcher.read(answer.iter_lines())
    except (httpx.HTTPError, httpx.StreamError):
        return


def test_the_state_of_everything_and_then_what_changes(client, building):
    with watching(client, "/api/v1/live") as live:
        until(lambda: ("camera", "c1") in live.known and ("object", "0/1") in live.known, lambda: live.known.keys())
        assert live.told[0] == "reset"
        assert live.known["camera", "c1"] == client.get("/api/v1/cameras/c1").json() | {
            "last_seen": live.known["camera", "c1"]["last_seen"]
        }
        assert live.known["building", ""]["ready"]
        assert live.known["traffic", "total"]["offered_bytes"] >= 0
        id = client.post("/api/v1/missions", json={"target": "tv"}).json()["id"]
        until(lambda: live.known.get(("mission", id)), "the mission never came")
        status = building.missions[id]
        building.put_status(msgspec.structs.replace(status, stamp_ns=clock_ns(), state="active", step=3))
        until(lambda: live.known["mission", id]["step"] == 3)
        until(lambda: live.known.get(("cost", id)), "nobody counts what it costs")
        assert client.get(f"/api/v1/missions/{id}/traffic").json()["mission"] == id
        assert client.get("/api/v1/missions/nobodys/traffic").status_code == 404
        building.put_status(msgspec.structs.replace(status, stamp_ns=clock_ns(), state="done", step=4))
        until(lambda: live.known["mission", id]["state"] == "done")


def test_the_client_knows_every_kind_that_is_sent():
    assert Gateway._live_resources(MagicMock()).keys() == rest.LIVE_RESOURCES.keys()


def test_what_only_was_heard_of_again_is_no_news(client, building):
    with watching(client, "/api/v1/live") as live:
        until(lambda: ("robot", "r1") in live.known)
        until(lambda: ("traffic", "total") in live.known)
        before = live.told.count("camera")
        building.put_sources()
        until(lambda: "beat" in live.told or live.told.count("traffic") > 6, timeout_s=20)
        assert live.told.count("camera") == before


def test_a_camera_that_is_forgotten_is_gone(client, building):
    with ExitStack() as stack:
        live = stack.enter_context(watching(client, "/api/v1/live"))
        info = msgspec.structs.replace(building.info, camera="c9", stamp_ns=clock_ns())
        with Node("camera", "c9", building.settings) as node:
            node.publisher(contract.CAMERA_INFO, floor="0", camera="c9").put(info)
            until(lambda: live.known.get(("camera", "c9")), "it never came")
        until(lambda: live.known["camera", "c9"]["stale"], "it never was stale")
        assert client.delete("/api/v1/cameras/c9").status_code == 204
        until(lambda: live.known["camera", "c9"] is None, "it never went")


def test_many_viewers_cost_a_camera_one_small_picture(router, building, start_gateway):
    with ExitStack() as stack:
        url, gateway = start_gateway(router, stack)
        client = stack.enter_context(httpx.Client(base_url=url, timeout=20))
        until(lambda: client.get("/api/v1/cameras").json()["total"])
        asked = building.thumbnails
        with (
            watching(client, "/api/v1/tiles?of=c1/3&of=c1/0") as one,
            watching(client, "/api/v1/tiles?of=c1/3") as other,
        ):
            until(lambda: one.known.get(("tile", "c1/3")) and other.known.get(("tile", "c1/3")), "no picture")
            until(lambda: one.known.get(("tile", "c1/0")))
            assert base64.b64decode(one.known["tile", "c1/3"]["jpeg"]).startswith(b"\xff\xd8")
            assert ("tile", "c1/0") not in other.known
            assert building.thumbnails - asked <= 4
            assert building.widths_px[-1] == tiles.WIDTH_PX
        until(lambda: gateway.tiles.n_streams == 0, "a client that went is kept")
        assert not gateway.tiles._due_s, "what nobody wants is asked for"


def test_a_tile_that_cant_be_had_says_why(client):
    with watching(client, "/api/v1/tiles?of=nobody/0&of=c1/77&of=c1/11") as watcher:
        until(lambda: len(watcher.known) == 3)
        problems = {id: state["problem"] for (_, id), state in watcher.known.items()}
        assert problems == {"nobody/0": "unknown_camera", "c1/77": "unknown_view", "c1/11": "bad_picture"}


@pytest.mark.parametrize(
    "asked", ["", "?of=c1", "?of=c1/x", "?of=../0", "?of=c1/12345", "?" + "of=c1/0&" * (tiles.MAX_TILES + 1)]
)
def test_tiles_that_make_no_sense_are_refused(client, asked):
    assert client.get(f"/api/v1/tiles{asked}").status_code == 422


def test_targets_are_what_perception_knows(client, building):
    def found() -> list[dict[str, Any]]:
        building.put_sources()  # a worker that was silent for long isn't asked
        return client.get("/api/v1/targets").json()["items"]

    assert {"name": "tv", "workers": ["w1"]} in until(found)


def test_the_page_is_made_of_files_that_are_all_there_and_need_nothing_from_elsewhere(client):
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    files = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert len(files) > 20
    for name in files:
        assert not name.startswith("/"), "addresses are relative: a proxy may have the gateway below a path"
        answer = client.get(name)
        assert answer.status_code == 200, name
        for how, imported in re.findall(r'(from |import\()"([^"]+)"', answer.text) if name.endswith(".js") else ():
            assert imported.startswith("."), (name, imported)
            module = str(httpx.URL(name).join(imported))
            assert client.get(module).status_code == 200, (name, imported)
            assert (module in files) == (how == "from "), (
                "what is needed at once is named by the page, and nothing else"
            )
    assert not re.search(r"<script(?![^>]*src=)|<style|\son\w+=", page.text), "nothing runs that is no file"


def test_names_on_the_bus_become_no_markup(client):
    for name in re.findall(r'"(static/\w+/page/[^"]+)"', client.get("/").text):
        text = client.get(name).text
        assert "innerHTML" not in text, name
        assert "dangerouslySetInnerHTML" not in text, name


def test_files_are_kept_for_good_and_the_page_is_asked_for_again(client):
    page = client.get("/")
    name = re.search(r'src="(static/\w+/page/main.js)"', page.text)[1]
    answer = client.get(name)
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-type"].startswith("text/javascript")
    assert "immutable" not in page.headers["cache-control"]
    for path, told in ((name, answer), ("/", page)):
        again = client.get(path, headers={"If-None-Match": told.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")


def test_a_page_of_yesterday_gets_files_of_today_for_now(client):
    answer = client.get("/static/0123456789abcdef/page/main.js")
    assert answer.status_code == 200
    assert "immutable" not in answer.headers["cache-control"]


@pytest.mark.parametrize(
    "name", ["x/page.html", "x/../service.py", "x/page/%2e%2e/%2e%2e/service.py", "x/", "x/page/none.js"]
)
def test_other_files_arent_given_out(client, name):
    assert client.get(f"/static/{name}").status_code == 404


def test_a_page_cut_off_a_hundred_times_shows_what_is(client, building, monkeypatch):
    """Things change all the while; the page reads some bytes, is gone, and goes on from its last id. At the end it knows the same
    as a page that was never cut off, and was never told to begin anew."""
    monkeypatch.setattr("surveilnav.services.gateway.stream_sources._COMPARE_PERIOD_S", 0.02)
    monkeypatch.setattr(LiveStates, "beat_s", 0.1)
    chance, known, last_id, resets = random.Random(7), {}, None, 0
    enough = threading.Event()

    def moves() -> None:
        while not enough.wait(0.05):
            building.put_sources()

    mover = threading.Thread(target=moves, daemon=True)
    mover.start()
    with watching(client, "/api/v1/live") as whole:
        until(lambda: ("building", "") in whole.known)
        for _ in range(100):
            budget = chance.randint(1, 3_000)
            with client.stream("GET", "/api/v1/live", headers={"Last-Event-ID": last_id} if last_id else {}) as answer:
                for told in blocks(within(budget, answer.iter_text())):
                    last_id = told.id
                    resets += told.kind == "reset"
                    if told.kind == "beat":
                        break
                    if told.kind != "reset":
                        known[told.kind, told.data["id"]] = told.data["state"]
        enough.set()
        mover.join()
        changes = lambda: {k: v for k, v in whole.known.items() if k[0] in ("robot", "camera", "mission", "floor")}  # noqa: E731
        with client.stream("GET", "/api/v1/live", headers={"Last-Event-ID": last_id}) as answer:
            watcher = Watcher()
            watcher.known = known
            thread = threading.Thread(target=lambda: _read(watcher, answer), daemon=True)
            thread.start()
            until(lambda: {k: known.get(k) for k in changes()} == changes(), "the page shows something else")
            watcher.ended = True
            thread.join(10)
    assert resets == 1, "the first time"
