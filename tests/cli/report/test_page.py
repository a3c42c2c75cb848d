"""The report of a run: what it says, that it stands alone, and that odd data doesn't break it."""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from surveilnav.cli.report.page import write_report
from surveilnav.cli.report.record import DecidingView, RunRecord, Step, TrafficLine
from surveilnav.cli.report.words import outcome
from surveilnav.messages import MissionStatus


class Page(HTMLParser):
    """Collects what a browser would load, the text, and tags that aren't closed."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.text: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "br", "img", "input"):
            self.open.append(tag)
        self.loads += [v or "" for k, v in attrs if k in ("src", "href")]
        self.handlers += [k for k, _ in attrs if k.startswith("on")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loads += [v or "" for k, v in attrs if k in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def written(record: RunRecord, folder: Path) -> tuple[Page, str]:
    path = folder / "report.html"
    write_report(record, path)
    html = path.read_text(encoding="utf-8")
    page = Page()
    page.feed(html)
    assert page.open == []
    return page, " ".join(" ".join(page.text).split())


def test_it_stands_alone(record, tmp_path):
    page, _ = written(record, tmp_path)
    assert page.loads
    assert all(address.startswith("data:image/webp;base64,") for address in page.loads)
    assert (page.tags.count("script"), page.handlers) == (2, [])  # the film's data and the film
    for address in page.loads:
        assert (
            cv2.imdecode(np.frombuffer(base64.b64decode(address.split(",")[1]), np.uint8), cv2.IMREAD_UNCHANGED)
            is not None
        )


def test_it_says_what_happened(record, tmp_path):
    _, text = written(record, tmp_path)
    assert (
        "The robot found the potted plant in the living room after 12 m and 34 s; camera c2 had seen it first." in text
    )
    assert "It stopped where it should after 42 steps: the simulator agrees. The shortest way is 10.4 m." in text
    for words in (
        "onnx-coco",
        "weights found",
        "3 of 4",
        "44 MB",
        "camera c2, view 1: first saw it",
        "potted plant 0.72",
        "Run on 2 CPU cores.",
        "2.9 MB",
        "Step 0: start",
        "Step 42: end",
    ):
        assert words in text, words


def _status(**changes: object) -> MissionStatus:
    facts: dict[str, object] = {
        "stamp_ns": 1,
        "mission": "m",
        "target": "tv",
        "robot": "r1",
        "state": "failed",
        "phase": "exploring",
        "step": 500,
        "max_steps": 500,
        "path_m": 80.0,
    }
    return MissionStatus(**(facts | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("status", "verdict", "tone", "words"),
    [
        (
            _status(state="done", found=True),
            {"success": False, "distance_to_viewpoint_m": 2.345},
            "half",
            "2.3 m from the nearest",
        ),
        (
            _status(state="done", found=True),
            {"success": False, "distance_to_viewpoint_m": math.inf},
            "half",
            "check says no.",
        ),
        (_status(error="out_of_steps"), {}, "bad", "ran out of steps"),
        (_status(error="not_found"), {}, "bad", "everything that it could reach was searched"),
        (_status(error="martians_came"), {}, "bad", "martians came"),
        (_status(), {}, "bad", "no reason was given"),
        (_status(state="cancelled"), {}, "bad", "cancelled"),
        (_status(state="active"), {}, "bad", "didn't end: it was active (exploring)"),
        (None, {}, "bad", "ended before"),
    ],
)
def test_outcomes_in_plain_words(record, status, verdict, tone, words, tmp_path):
    ended = replace(record, status=status, verdict=verdict)
    assert outcome(ended)[0] == tone
    assert words in outcome(ended)[1]
    assert words in written(ended, tmp_path)[1]


def test_nothing_at_all_still_gives_a_report(record, tmp_path):
    empty = RunRecord(
        building="b",
        seed=0,
        target="tv",
        perception="oracle",
        perception_why="asked",
        surveillance=False,
        started=record.started,
        seconds=0.0,
    )
    _, text = written(empty, tmp_path)
    assert "surveillance off" in text


def test_odd_data_is_left_out_or_escaped(record, tmp_path):
    evil = '<script>alert("x")</script>'
    grid, _ = record.layers["0"]["explored"]
    odd = replace(
        record,
        building=evil,
        target=evil,
        perception_why=evil,
        notes=[evil],
        cameras=[msgspec.structs.replace(record.cameras[0], camera=evil)],
        layers={
            evil: {
                "value": (grid, np.full(grid.shape, np.nan, np.float32)),
                "explored": (grid, np.zeros(grid.shape, np.uint8)),
            }
        },
        trajectory=[Step(math.nan, 0.0, evil), Step(1.0, 2.0, "0")],
        objects=[
            msgspec.structs.replace(
                record.objects[0], label=evil, reason=evil, confidence=math.nan, center_m=(math.nan, 0.0, 0.0)
            )
        ],
        deciding_views=[
            DecidingView(evil, b"no jpeg", []),
            DecidingView("", record.deciding_views[0].jpeg, [(0, 0, 9e9, 9e9, evil, math.nan)]),
        ],
        traffic=[TrafficLine(evil, "service", 0, 0, None)],
        verdict={evil: evil},
    )
    page, text = written(odd, tmp_path)
    assert (page.tags.count("script"), page.handlers) == (2, [])
    assert "doesn't decode" in text
