"""Handing payloads over in a folder, also between processes that misbehave."""

from __future__ import annotations

import os
import shutil
import threading
import time
from contextlib import ExitStack

import pytest

from surveilnav.bus import Answer, Node, Unanswered, handover, queries
from surveilnav.bus.handover import HandoverFolder
from surveilnav.contract import VIEW_LOG
from surveilnav.messages import LoggedView
from surveilnav.storage import TEMPORARY
from tests.waiting import until

MB = 1 << 20


def test_another_process_reads_what_one_has_left(tmp_path):
    one, other = HandoverFolder(tmp_path / "share", MB), HandoverFolder(tmp_path / "share", MB)
    name = one.put(b"a picture")
    assert one.token
    assert other.token == one.token
    assert other.get(name) == b"a picture"
    assert one.put(b"a picture") == name
    assert HandoverFolder(tmp_path / "elsewhere", MB).token != one.token


def test_processes_that_begin_at_once_agree_on_the_token(tmp_path):
    gate, tokens = threading.Barrier(8), []

    def begin():
        gate.wait()
        tokens.append(HandoverFolder(tmp_path / "share", MB).token)

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(tokens)) == 1
    assert tokens[0]
    assert os.listdir(tmp_path / "share") == ["token"]


def test_the_oldest_make_room(tmp_path):
    share = HandoverFolder(tmp_path, 250)
    names = [share.put(bytes([n]) * 100) for n in range(3)]
    assert [share.get(name) is not None for name in names] == [False, True, True]
    share.put(b"\1" * 100)  # is used again, so the other is the oldest now
    share.put(b"\3" * 100)
    assert [share.get(name) is not None for name in names] == [False, True, False]
    assert share.put(b"x" * 251) == "", "larger than all the room"
    assert len(os.listdir(tmp_path)) == 3


@pytest.mark.parametrize(
    "name", ["", "token", "../token", "0" * 31, "0" * 32, "G" * 32, "/etc/passwd", "0" * 32 + "\n"]
)
def test_only_names_of_pictures_are_read(tmp_path, name):
    assert HandoverFolder(tmp_path, MB).get(name) is None


def test_what_is_not_as_its_name_says_is_none(tmp_path):
    share = HandoverFolder(tmp_path, MB)
    name = share.put(b"a picture")
    (tmp_path / name).write_bytes(b"another")
    assert share.get(name) is None


def test_without_a_folder_nothing_is_shared(tmp_path):
    (tmp_path / "a file").write_text("")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "token").write_text("what somebody else wrote")
    for share in (
        HandoverFolder(None, MB),
        HandoverFolder(tmp_path / "a file", MB),
        HandoverFolder(tmp_path / "a file" / "below", MB),
        HandoverFolder(tmp_path / "odd", MB),
    ):
        assert (share.token, share.put(b"a picture"), share.get("0" * 32)) == ("", "", None)
        share.clear()


def test_a_full_memory_is_no_error(tmp_path, monkeypatch):
    share = HandoverFolder(tmp_path, MB)
    known = share.put(b"known")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(handover, "atomic_write", full)
    assert share.put(b"new") == ""
    assert share.put(b"known") == known


def test_a_picture_that_somebody_removed_is_left_again(tmp_path):
    share = HandoverFolder(tmp_path, MB)
    name = share.put(b"a picture")
    (tmp_path / name).unlink()
    assert share.get(name) is None
    assert share.get(share.put(b"a picture")) == b"a picture"


def test_forgotten_pictures_are_gone_whoever_wrote_them(tmp_path):
    one, other = HandoverFolder(tmp_path, MB), HandoverFolder(tmp_path, MB)
    names = [one.put(b"one"), other.put(b"other")]
    one.clear()
    assert [one.get(name) for name in names] == [None, None]
    assert os.listdir(tmp_path) == ["token"]


def test_what_nobody_has_fetched_is_removed_after_a_while(tmp_path):
    share = HandoverFolder(tmp_path, MB)
    old, new, again = share.put(b"old"), share.put(b"new"), share.put(b"again")
    long_ago_s = time.time() - 60
    for name in (old, again):
        os.utime(tmp_path / name, (long_ago_s, long_ago_s))
    share.put(b"again")
    HandoverFolder(tmp_path, MB).remove_old()
    assert (share.get(old), share.get(new), share.get(again)) == (None, b"new", b"again")


def test_a_folder_that_another_user_made_is_not_used(tmp_path, monkeypatch):
    """Anybody may make a folder of a name that can be guessed, or a link to one, and read what is left in it."""
    (tmp_path / "link").symlink_to(tmp_path)
    assert HandoverFolder(tmp_path / "link", MB).token == ""
    (tmp_path / "theirs").mkdir()
    if os.getuid() == 0:
        os.chown(tmp_path / "theirs", 12_345, -1)
    else:
        me = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: me + 1)
    assert HandoverFolder(tmp_path / "theirs", MB).token == ""


def test_what_a_killed_writer_had_begun_is_removed_and_a_folder_that_is_gone_is_no_error(tmp_path):
    folder = HandoverFolder(tmp_path / "one", MB)
    begun = tmp_path / "one" / f".half{TEMPORARY}"
    begun.write_bytes(b"half")
    long_ago_s = time.time() - 60
    os.utime(begun, (long_ago_s, long_ago_s))
    folder.remove_old()
    assert os.listdir(tmp_path / "one") == ["token"]
    shutil.rmtree(tmp_path / "one")
    folder.remove_old()
    folder.clear()


def test_whatever_somebody_puts_into_the_folder_stops_nobody(tmp_path):
    folder = HandoverFolder(tmp_path / "one", MB)
    names = {kind: f"{n:032x}" for n, kind in enumerate(("fifo", "link", "huge", "folder"))}
    os.mkfifo(tmp_path / "one" / names["fifo"])
    (tmp_path / "one" / names["link"]).symlink_to("/dev/zero")
    (tmp_path / "one" / names["huge"]).touch()
    os.truncate(tmp_path / "one" / names["huge"], 1 << 40)
    (tmp_path / "one" / names["folder"]).mkdir()
    assert [folder.get(name) for name in names.values()] == [None] * 4
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "token").write_bytes(b"\xff" * 40)
    assert HandoverFolder(tmp_path / "two", MB).token == ""


def test_who_ends_takes_what_it_left_with_it(tmp_path):
    one, other = HandoverFolder(tmp_path, MB), HandoverFolder(tmp_path, MB)
    mine, theirs = one.put(b"mine"), other.put(b"theirs")
    one.close()
    assert (other.get(mine), other.get(theirs)) == (None, b"theirs")


def test_a_folder_that_was_removed_is_not_made_again(tmp_path):
    folder = HandoverFolder(tmp_path / "one", MB)
    shutil.rmtree(tmp_path / "one")
    assert folder.put(b"a payload") == ""
    assert not (tmp_path / "one").exists()


# --- answers on the bus -----------------------------------------------------------------------------------------------

LARGE, SMALL = bytes(range(256)) * 1000, b"small"


@pytest.fixture
def two(bus, tmp_path):
    """``two(folder of the asker, folder of the one who answers)``: both as nodes; what the latter was asked with."""
    with ExitStack() as stack:

        def start(asking, answering):
            folders = [bus.model_copy(update={"handover_folder": f and tmp_path / f}) for f in (asking, answering)]
            asker = stack.enter_context(Node("test", "asker", folders[0], alive=False))
            server = stack.enter_context(Node("fusion", "fusion", folders[1]))
            asked = []

            def answer(request):
                asked.append(request.parameters)
                payload = SMALL if request.parameters.get("size") == "small" else LARGE
                return Answer(LoggedView(stamp_ns=1, number=1, newest=1), payload)

            server.serve(VIEW_LOG, answer)
            until(lambda: asker.ask_all(VIEW_LOG, timeout_s=0.5))
            until(lambda: sent_bytes(server) >= len(asked) * len(LARGE))  # an answer is counted once it was sent
            asked.clear()
            return asker, server, asked

        yield start


def sent_bytes(server):
    return sum(row.n_bytes for row in server.traffic.rows() if row.direction == "offered" and "view_log" in row.key)


def sent_since(server, before):
    """The bytes of the answers since then, once they were counted."""
    until(lambda: sent_bytes(server) > before)
    return sent_bytes(server) - before


@pytest.mark.parametrize(
    ("asking", "answering", "is_handed"),
    [("one", "one", True), ("one", "other", False), (None, "one", False), ("one", None, False), (None, None, False)],
)
def test_a_large_answer_is_handed_over_where_both_see_the_folder(two, asking, answering, is_handed):
    asker, server, asked = two(asking, answering)
    before = sent_bytes(server)
    received = asker.ask(VIEW_LOG, parameters={"after": "3"})
    assert (received.payload, received.message.number) == (LARGE, 1)
    assert asked == [{"after": "3"}], "the handler isn't told of it"
    assert (sent_since(server, before) < 1000) == is_handed


def test_a_small_answer_is_sent(two, tmp_path):
    asker, _, _ = two("one", "one")
    assert asker.ask(VIEW_LOG, parameters={"size": "small"}).payload == SMALL
    assert os.listdir(tmp_path / "one") == ["token"]


def test_what_is_gone_when_it_is_fetched_is_sent(two, monkeypatch):
    asker, server, asked = two("one", "one")
    monkeypatch.setattr(asker.handover, "get", lambda name: None)
    before = sent_bytes(server)
    assert asker.ask(VIEW_LOG).payload == LARGE
    assert len(asked) == 2
    until(lambda: sent_bytes(server) - before > len(LARGE))


def test_answers_of_several_are_sent(two):
    asker, server, _ = two("one", "one")
    before = sent_bytes(server)
    assert [a.payload for a in asker.ask_all(VIEW_LOG, timeout_s=1.0)] == [LARGE]
    assert sent_since(server, before) > len(LARGE)


@pytest.mark.parametrize("name", ["../../etc/passwd", "token", "0" * 32, "x" * 100])
def test_a_name_that_somebody_made_up_gets_nothing(two, monkeypatch, name):
    asker, server, _ = two("one", "one")
    monkeypatch.setattr(server.handover, "put", lambda payload: name)
    assert asker.ask(VIEW_LOG).payload == LARGE, "it asks again, and is sent it"


def test_who_always_answers_with_a_name_is_asked_twice_and_no_more(two, monkeypatch):
    """It takes no notice that the asker told no folder the second time."""
    asker, _, asked = two("one", "one")
    monkeypatch.setattr(queries.QueryServer, "_handed", lambda *_: "0" * 32)
    with pytest.raises(Unanswered, match="can't be read"):
        asker.ask(VIEW_LOG, timeout_s=5.0)
    assert len(asked) == 2
