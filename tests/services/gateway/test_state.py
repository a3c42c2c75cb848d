"""What is remembered of a stream that is put on change, while it is asked for again; on a node that is none."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from surveilnav.contract import CAMERA_INFO
from surveilnav.services.gateway import state
from surveilnav.services.gateway.state import LastKnown


def row(camera: str) -> SimpleNamespace:
    return SimpleNamespace(
        key=camera, ids={"camera": camera}, message=SimpleNamespace(camera=camera, stamp_ns=1), received_ns=1
    )


class FakeNode:
    """Answers when the test lets it."""

    def __init__(self) -> None:
        self.asked, self.go = threading.Event(), threading.Event()
        self.answers = [row("c1"), row("c2")]

    def table(self, stream, on_message):
        return SimpleNamespace(rows=list, clear=lambda: None, forget=lambda field, id: None)

    def ask_all(self, stream, timeout_s):
        self.asked.set()
        assert self.go.wait(10)
        return self.answers


def asking(monkeypatch) -> tuple[LastKnown, FakeNode, threading.Thread]:
    """One reader asks, and waits for the answer."""
    monkeypatch.setattr(state, "REFRESH_S", 0.0)
    node = FakeNode()
    known = LastKnown(node, CAMERA_INFO)
    reader = threading.Thread(target=known.rows)
    reader.start()
    assert node.asked.wait(10)
    return known, node, reader


def test_who_reads_while_another_asks_doesnt_wait(monkeypatch):
    known, node, reader = asking(monkeypatch)
    assert known.rows() == []
    node.go.set()
    reader.join(10)
    assert list(known.newest("camera")) == ["c1", "c2"]


def test_what_was_dropped_meanwhile_doesnt_come_back_with_the_answer(monkeypatch):
    known, node, reader = asking(monkeypatch)
    known.clear()
    monkeypatch.setattr(state, "REFRESH_S", 60.0)
    node.go.set()
    reader.join(10)
    assert known.rows() == []
    monkeypatch.setattr(state, "REFRESH_S", 0.0)
    assert list(known.newest("camera")) == ["c1", "c2"], "and is asked for anew"


@pytest.mark.parametrize(("present", "n_queries"), [({"c1", "c2"}, 1), ({"c1", "c2", "c3"}, 3), (set(), 0)])
def test_cameras_are_asked_again_only_while_one_of_them_has_said_nothing(monkeypatch, present, n_queries):
    monkeypatch.setattr(state, "REFRESH_S", 0.0)
    node, asked = FakeNode(), []
    node.go.set()
    node.alive = lambda kind: present if kind == "camera" else pytest.fail(kind)
    answer = node.ask_all
    node.ask_all = lambda *a, **k: asked.append(1) or answer(*a, **k)
    known = LastKnown(node, CAMERA_INFO, publishers="camera")
    for _ in range(3):
        known.rows()
    assert len(asked) == n_queries
