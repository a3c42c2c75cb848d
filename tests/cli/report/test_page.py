"""The report of a run: what it says, that it stands alone, and that odd data doesn't break it."""

from __future__ import annotations

import base64
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from surveilnav.cli.report import DecidingView, Moment, RunRecord, Step, TrafficLine, outcome, write_report
from surveilnav.cli.report.floor_map import DOUBTED, TARGET
from surveilnav.geometry import Grid
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
    kinds = tuple(f"data:image/{kind};base64," for kind in ("png", "jpeg", "webp"))
    assert all(address.startswith(kinds) for address in page.loads)
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
        "confirmed",
        "rejected",
        "class flipped to vase",
        "couch 1",
        "the one it went to",
        "camera c2, view 1: first saw it",
        "potted plant 0.72",
        "approaching",
        "Run on 2 CPU cores.",
        "2.9 MB",
        "start",
        "stop",
    ):
        assert words in text, words


def test_what_is_confirmed_as_something_else_is_not_marked_as_the_target(record, tmp_path):
    found = next(o for o in record.objects if o.status == "confirmed" and o.label == record.target)
    other = msgspec.structs.replace(found, id=99, label="vase", reason="seen as a vase")
    boxes = {}
    for name, objects in (("target", record.objects), ("both", [*record.objects, other])):
        (tmp_path / name).mkdir()
        _, text = written(replace(record, objects=objects), tmp_path / name)
        html = (tmp_path / name / "report.html").read_text(encoding="utf-8")
        boxes[name] = (
            len(re.findall(f'<rect [^>]*stroke="{TARGET}"', html)),
            len(re.findall(f'stroke="{DOUBTED}"', html)),
        )
        assert "vase 0.72" not in text
    assert boxes["both"] == (boxes["target"][0], boxes["target"][1] + 1)


def test_the_camera_that_decided_is_marked(record, tmp_path):
    _, text = written(record, tmp_path)
    assert re.findall(r"camera (c\d): (\w[\w ]*?) c\d", text) == [
        ("c1", "in use"),
        ("c2", "decided"),
        ("c3", "in use"),
        ("c4", "not in use"),
    ]
    untold = replace(record, deciding_views=[DecidingView("a", v.jpeg, v.boxes) for v in record.deciding_views])
    assert "camera c2: decided" in written(untold, tmp_path)[1]  # from the history of the object that was found
    elsewhere = replace(record, deciding_views=[DecidingView("a", b"", [], "camera/c3", 0)])
    assert "camera c3: decided" in written(elsewhere, tmp_path)[1]


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
    assert "Nothing was ever taken for a tv." in text


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
        timeline=[Moment(math.nan, evil, evil), Moment(0.0, evil, evil)],
        verdict={evil: evil},
    )
    page, text = written(odd, tmp_path)
    assert (page.tags.count("script"), page.handlers) == (2, [])
    assert "doesn't decode" in text


def test_layers_lie_where_they_belong(record, tmp_path):
    """One explored cell: its picture covers the pixel that the frame gives its place."""
    grid = Grid(0.0, 0.0, 0.5, 20, 20)
    cells = np.zeros((20, 20), np.uint8)
    cells[2, 4] = 1  # x 2.0-2.5, y 1.0-1.5
    bare = replace(
        record,
        layers={"0": {"explored": (grid, cells)}},
        cameras=[],
        objects=[],
        plans=[],
        deciding_views=[],
        trajectory=[Step(0.25, 0.25, "0"), Step(9.75, 4.75, "0")],
    )
    write_report(bare, tmp_path / "r.html")
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    image = re.search(
        r'href="data:image/png;base64,([^"]+)" x="([-\d.]+)" y="([-\d.]+)" width="([\d.]+)" height="([\d.]+)"', html
    )
    u, v, _ = (
        float(x) for x in re.search(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="(7)"', html).groups()
    )  # the start at (0.25, 0.25)
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(image[1]), np.uint8), cv2.IMREAD_UNCHANGED)
    x, y, width, height = (float(image[i]) for i in range(2, 6))
    scale = width / picture.shape[1] / 0.5
    row, col = np.argwhere(picture[..., 3])[0]
    centre = x + (col + 0.5) * width / picture.shape[1], y + (row + 0.5) * height / picture.shape[0]
    assert centre == pytest.approx((u + (2.25 - 0.25) * scale, v - (1.25 - 0.25) * scale), abs=0.5)
