"""Recordings by REST: listed, downloaded whole and in parts, deleted; their recorder has the files, here a fake."""

from __future__ import annotations

import os

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.selection import byte_range
from tests.waiting import until

IDS = [f"2026112{day}T143519250Z_m{day}" for day in (7, 6, 5)]
CONTENT = os.urandom(2_500_000)


class FakeRecorder:
    """Three recordings; the newest is being written."""

    def __init__(self, node: Node) -> None:
        self.files, self.asked, self.broken = dict.fromkeys(IDS, CONTENT), 0, False
        node.serve(contract.RECORDINGS, self._list, recorder="rec")
        node.serve(contract.RECORDING_READ, self._read, recorder="rec")
        node.serve(contract.RECORDING_DELETE, self._delete, recorder="rec")
        self._status = node.publisher(contract.RECORDER_STATUS, recorder="rec")

    def put(self, problem: str = "") -> None:
        self._status.put(
            m.RecorderStatus(
                stamp_ns=clock_ns(),
                recorder="rec",
                recording=IDS[:1],
                problem=problem,
                dropped=4,
                n_bytes=7,
                free_bytes=9,
            )
        )

    def _list(self, _: Request) -> Answer:
        found = [
            m.Recording(
                id=id,
                mission=id[-2:],
                state="recording" if id == IDS[0] else "complete",
                n_bytes=len(content),
                started_ns=10**18 + int(id[-1]) * 10**9,
                changed_ns=2 * 10**18,
                target="tv",
                cameras=None if id == IDS[0] else ["c-shown"],
            )
            for id, content in self.files.items()
        ]
        return Answer(m.RecordingList(stamp_ns=1, recorder="rec", recordings=found))

    def _read(self, request: Request) -> Answer:
        self.asked += 1
        part = request.message
        data = b"" if self.broken else self.files[part.id][part.offset : part.offset + part.n_bytes]
        return Answer(m.RecordingPart(stamp_ns=1, id=part.id, offset=part.offset), data)

    def _delete(self, request: Request) -> Answer:
        if request.message.id == IDS[0]:
            raise Refused("recording", "it is being written: cancel its mission first")
        del self.files[request.message.id]
        return Answer(m.Ack(stamp_ns=1))


@pytest.fixture(scope="module")
def recorder(client: httpx.Client, building) -> FakeRecorder:
    return FakeRecorder(building.node("recorder", "rec"))


@pytest.fixture
def files(recorder: FakeRecorder, client: httpx.Client) -> FakeRecorder:
    recorder.files, recorder.asked, recorder.broken = dict.fromkeys(IDS, CONTENT), 0, False
    until(lambda: client.get("/api/v1/recordings").status_code == 200, "the recorder isn't there")
    return recorder


def test_recordings_are_listed_newest_first_and_in_pages(client, files):
    told = client.get("/api/v1/recordings").json()
    assert [r["id"] for r in told["items"]] == IDS
    assert (told["total"], told["next"]) == (3, None)
    first = told["items"][0]
    assert (first["state"], first["mission"], first["target"], first["recorder"]) == ("recording", "m7", "tv", "rec")
    assert first["started"] == "2001-09-09T01:46:47Z"
    page = client.get("/api/v1/recordings", params={"limit": 2}).json()
    assert [r["id"] for r in page["items"]] == IDS[:2]
    rest = client.get("/api/v1/recordings", params={"limit": 2, "cursor": page["next"]}).json()
    assert ([r["id"] for r in rest["items"]], rest["next"]) == (IDS[2:], None)
    assert [r["id"] for r in client.get("/api/v1/recordings?mission=m6").json()["items"]] == [IDS[1]]
    assert client.get(f"/api/v1/recordings/{IDS[1]}").json()["n_bytes"] == len(CONTENT)


def test_a_file_is_downloaded_whole(client, files):
    answer = client.get(f"/api/v1/recordings/{IDS[1]}/file")
    assert (answer.status_code, answer.content) == (200, CONTENT)
    assert answer.headers["content-disposition"] == f'attachment; filename="{IDS[1]}.mcap"'
    assert files.asked == 3, "a megabyte at a time"


@pytest.mark.parametrize(
    ("asked", "first", "after"),
    [
        ("bytes=0-0", 0, 1),
        ("bytes=5-1500000", 5, 1_500_001),
        ("bytes=2499990-", 2_499_990, 2_500_000),
        ("bytes=-10", 2_499_990, 2_500_000),
        ("bytes=10-99999999", 10, 2_500_000),
    ],
)
def test_a_download_goes_on_where_it_broke_off(client, files, asked, first, after):
    answer = client.get(f"/api/v1/recordings/{IDS[1]}/file", headers={"range": asked})
    assert (answer.status_code, answer.content) == (206, CONTENT[first:after])
    assert answer.headers["content-range"] == f"bytes {first}-{after - 1}/2500000"


def test_a_file_that_grew_meanwhile_is_sent_anew(client, files):
    url = f"/api/v1/recordings/{IDS[0]}/file"
    tag = client.get(url, headers={"range": "bytes=0-9"}).headers["etag"]
    assert client.get(url, headers={"range": "bytes=10-19", "if-range": tag}).status_code == 206
    files.files[IDS[0]] = CONTENT + b"more"
    assert client.get(url, headers={"range": "bytes=10-19", "if-range": tag}).status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "headers", "status", "name"),
    [
        ("GET", f"/{IDS[1]}/file", {"range": "bytes=2500000-"}, 416, "no_such_range"),
        ("GET", f"/{IDS[1]}/file", {"range": "bytes=-0"}, 416, "no_such_range"),
        ("GET", "/20200101T000000000Z_m1", {}, 404, "unknown_recording"),
        ("GET", "/..%2F..%2Fetc%2Fpasswd/file", {}, 404, "no_such_address"),
        ("GET", "/-x", {}, 422, "invalid"),
        ("DELETE", f"/{IDS[0]}", {}, 409, "recording"),
        ("DELETE", "/20200101T000000000Z_m1", {}, 404, "unknown_recording"),
        ("GET", "?cursor=x", {}, 422, "bad_cursor"),
    ],
)
def test_what_cant_be_had(client, files, method, path, headers, status, name):
    answer = client.request(method, f"/api/v1/recordings{path}", headers=headers)
    assert (answer.status_code, answer.json()["type"].rpartition(":")[2]) == (status, name)


def test_a_recorder_that_answers_wrongly_is_named_before_anything_is_sent(client, files):
    files.broken = True
    answer = client.get(f"/api/v1/recordings/{IDS[1]}/file")
    assert (answer.status_code, answer.json()["type"].rpartition(":")[2]) == (502, "bad_part")


@pytest.mark.parametrize(("id", "camera"), [(IDS[1], "c-shown"), (IDS[0], "c1")])
def test_who_downloads_a_recording_has_looked_at_its_cameras(client, files, id, camera):
    """One that isn't complete doesn't say whom it shows: then it may be any."""

    def looks():
        told = client.get(f"/api/v1/cameras/{camera}/looks", params={"limit": 1000}).json()["items"]
        return [(look["view"], look["what"]) for look in told if look["what"] == "recording"]

    before = looks()
    client.get(f"/api/v1/recordings/{id}/file", headers={"range": "bytes=0-9"})
    assert looks() in (before, [*before, (-1, "recording")])  # the same again within a minute is one look
    assert looks()


def test_a_recording_is_deleted(client, files):
    assert client.delete(f"/api/v1/recordings/{IDS[1]}").status_code == 204
    assert [r["id"] for r in client.get("/api/v1/recordings").json()["items"]] == [IDS[0], IDS[2]]


def test_recorders_say_what_is_wrong(client, files):
    files.put("the disk is full")
    until(lambda: client.get("/api/v1/recorders").json()["total"] == 1, "nobody heard of the recorder")
    told = client.get("/api/v1/recorders").json()["items"][0]
    assert (told["id"], told["problem"], told["recording"], told["stale"]) == (
        "rec",
        "the disk is full",
        IDS[:1],
        False,
    )
    text = client.get("/metrics").text
    assert 'surveilnav_recorder_problem{recorder="rec"} 1.0' in text
    assert 'surveilnav_recorder_dropped_total{recorder="rec"} 4.0' in text


@given(st.integers(0, 100), st.one_of(st.text(max_size=20), st.from_regex(r"bytes=\d{0,3}-\d{0,3}", fullmatch=True)))
def test_a_range_lies_in_the_file_or_is_refused(total, header):
    try:
        part = byte_range(header, total)
    except Problem:
        return
    assert part is None or 0 <= part[0] < part[1] <= total
