"""The film strip: what each frame tells, and that five hundred steps stay small."""

from __future__ import annotations

import base64
import json
import math
import re
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from surveilnav.cli.report.film import film_of
from surveilnav.cli.report.key_moments import key_moments
from surveilnav.cli.report.page import write_report
from surveilnav.cli.report.record import MapMoment, RunRecord, Step
from surveilnav.cli.report.small_pictures import small_pictures
from surveilnav.cli.report.why import reasons
from surveilnav.geometry import Grid
from surveilnav.messages import Candidate


def data_of(html: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="film-data">(.*?)</script>', html, re.S)[1])


def test_frames_tell_what_was_seen_weighed_and_believed(record, tmp_path):
    write_report(record, tmp_path / "r.html")
    data = data_of((tmp_path / "r.html").read_text(encoding="utf-8"))
    frames = data["frames"]
    assert len(frames) == len(record.trajectory)
    assert [f["step"] for f in frames] == list(range(len(frames)))
    assert all(f["picture"] for f in frames)
    assert [m["frame"] for m in data["maps"]] == list(range(0, len(frames), 3))
    assert frames[0]["plan"]["candidates"][0]["kind"] == "frontier"
    waypoint = frames[21]["plan"]["waypoint"]
    assert (waypoint["kind"], waypoint["x_m"], waypoint["y_m"]) == ("target", 9.8, 6.2)
    number = [o["id"] for o in data["objects"]].index(4)
    first, *_, last = [s for s in data["sightings"] if s[1] == number]
    assert first == [10, number, "candidate", "potted plant", 0.72, ["camera/c2"]]
    assert last == [len(frames) - 1, number, "confirmed", "potted plant", 0.82, ["camera/c2", "robot/r1"]]
    assert [e["what"] for e in data["objects"][number]["history"]] == ["created", "matched", "confirmed"]


def test_layers_lie_where_they_belong(record, tmp_path):
    """One explored cell: its picture is cut to it, and says where in the world it lies."""
    grid = Grid(0.0, 0.0, 0.5, 20, 20)
    cells = np.zeros((20, 20), np.uint8)
    cells[2, 4] = 1  # x 2.0-2.5, y 1.0-1.5
    values = np.full((20, 20), np.nan, np.float32)
    values[2:4, 4] = 0.25, 0.75
    layers = {"0": {"explored": (grid, cells), "value": (grid, values), "frontier": (grid, 0 * cells)}}
    drawn = film_of(record).data(replace(record, layers=layers))["layers"]["0"]
    assert drawn.keys() == {"explored", "value"}  # nothing is a frontier
    assert (drawn["explored"]["grid"], drawn["explored"]["range"]) == ([2.0, 1.0, 0.5, 1, 1], None)
    assert (drawn["value"]["grid"], drawn["value"]["range"]) == ([2.0, 1.0, 0.5, 2, 1], [0.25, 0.75])
    png = cv2.imdecode(np.frombuffer(base64.b64decode(drawn["value"]["png"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png.shape == (2, 1, 4)
    assert png[0, 0, 1] > png[1, 0, 1]  # the north is up, and the higher value is lighter


def test_maps_that_are_too_large_are_thinned_and_the_newest_stays(record):
    rng = np.random.default_rng(0)
    grid = Grid(0.0, 0.0, 0.05, 200, 200)
    noise = [rng.integers(0, 2, (200, 200)).astype(np.uint8) for _ in range(3)]
    moments = [MapMoment(i, "0", grid, MapMoment.pack(noise[i % 3], noise[i % 2])) for i in range(40)]
    film = film_of(record)
    maps = film.data(replace(record, map_moments=moments))["maps"]
    assert 0 < len(maps) < 40
    assert maps[-1]["frame"] == 39
    assert sum(len(layer["png"]) for m in maps for layer in m["layers"].values()) <= 350_000


def test_key_moments_are_few_and_tell_the_search(record):
    film = film_of(record)
    moments = key_moments(film, "potted plant")
    assert 4 <= len(moments) <= 6
    assert moments[0].title == "Step 0: start"
    assert moments[-1].title == "Step 42: end"
    assert any("goes to the confirmed target" in m.title for m in moments)
    assert any("taken for a potted plant by camera c2" in m.title for m in moments)
    assert all(m.view for m in moments)


def noisy_run(record: RunRecord, n_steps: int) -> RunRecord:
    """Steps with pictures that hardly compress, plans that weigh much."""
    rng = np.random.default_rng(0)
    pictures = [
        cv2.imencode(".jpg", rng.integers(0, 255, (480, 640, 3), np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 60])[1].tobytes()
        for _ in range(4)
    ]
    walked = [
        Step(0.01 * i, 1.0 + math.sin(i), "0", i, i, 0.5 * i, 0.1 * i, 0.2 * i, jpeg=pictures[i % 4])
        for i in range(n_steps + 1)
    ]
    weighed = [Candidate("frontier", x, 1.0, 0.1 * x, False, "a note " * 40) for x in range(40)]
    plans = [
        msgspec.structs.replace(
            record.plans[0],
            seq=i,
            step=i,
            candidates=weighed,
            why="why " * 90,
            path_m=[tuple(p) for p in rng.random((400, 2))],
        )
        for i in range(n_steps + 1)
    ]
    seen = [e for e in record.objects[0].history for _ in range(500)]
    objects = [msgspec.structs.replace(record.objects[0], id=i, history=seen) for i in range(40)]
    return replace(record, trajectory=walked, plans=plans, objects=objects)


@pytest.mark.parametrize("n_steps", [500, 1300])
def test_a_long_search_stays_small(record, tmp_path, n_steps):
    write_report(noisy_run(record, n_steps), tmp_path / "r.html")
    assert (tmp_path / "r.html").stat().st_size <= 3_000_000
    frames = data_of((tmp_path / "r.html").read_text(encoding="utf-8"))["frames"]
    assert 400 <= len(frames) <= 501
    assert (frames[0]["step"], frames[-1]["step"]) == (0, n_steps)


def test_pictures_as_good_as_the_budget_allows(record):
    jpeg = record.trajectory[0].jpeg
    widths = []
    for budget in (10**6, 60_000, 20_000, 3_000):
        small = small_pictures([jpeg] * 20 + [b"", b"no jpeg"], budget)
        assert sum(map(len, small)) <= budget
        assert small[20:] == [b"", b""]
        widths.append(cv2.imdecode(np.frombuffer(small[0], np.uint8), cv2.IMREAD_COLOR).shape[1])
    assert widths == sorted(widths, reverse=True)
    assert widths[0] > widths[-1]
    assert small_pictures([], 10) == []


def test_places_that_are_none_are_left_out(record):
    nan = math.nan
    plan = msgspec.structs.replace(
        record.plans[0],
        seq=0,
        waypoint=Candidate("frontier", nan, 0.0, 1.0, True),
        candidates=[Candidate("frontier", nan, 0.0, 1.0), Candidate("frontier", 1.0, 0.0, 0.5)],
        path_m=[(nan, 1.0), (0.0, 0.0), (1.0, 1.0)],
    )
    odd = replace(record, plans=[plan], trajectory=[Step(nan, 0.0, "0"), *record.trajectory])
    frame = film_of(odd).data(odd)["frames"][0]
    assert frame["plan"]["waypoint"] is None
    assert [c["x_m"] for c in frame["plan"]["candidates"]] == [1.0]
    assert frame["plan"]["path_m"] == [[0.0, 0.0], [1.0, 1.0]]
    assert film_of(replace(record, trajectory=[])) is None


def test_a_failure_says_what_is_known_of_why(record):
    status = msgspec.structs.replace(record.status, state="failed", found=False, error="out_of_steps", object_id=None)
    failed = replace(record, status=status, verdict={"success": False, "distance_to_viewpoint_m": 3.21})
    text = " ".join(reasons(failed, record.objects[1:2]))
    for words in (
        "Of 43 planned steps these led: 22 to what was confirmed as the target, 21 to edges of what was known.",
        "The likeliest was object 7, called potted plant, with a confidence of 0.55; it was rejected: class flipped to vase.",
        "At the end, 2 edges of what was known waited to be explored.",
        "3 of 4 cameras were asked for pictures.",
        "At the end the robot was 3.2 m from",
    ):
        assert words in text, words
    nobody = " ".join(reasons(replace(failed, plans=[], surveillance=False), []))
    assert "Neither the robot nor a camera ever took anything for a potted plant." in nobody
    assert "No surveillance camera took part." in nobody
    assert reasons(record, []) == []


def test_steps_are_numbered_as_the_planner_counts(record):
    """A stair counts as several steps, and where no plan was heard of the observations count on."""
    plans = [
        msgspec.structs.replace(p, step=p.seq + (20 if p.seq > 30 else 0)) for p in record.plans if p.seq not in (5, 6)
    ]
    status = msgspec.structs.replace(record.status, step=63)
    film = film_of(replace(record, plans=plans, status=status))
    assert list(film.numbers) == [*range(31), *range(51, 62), 63]


def test_what_it_stopped_for_in_vain_is_said(record):
    wrong = replace(record, verdict={"found": True, "success": False})
    text = " ".join(reasons(wrong, record.objects))
    assert "It stopped for object 4, called potted plant, with a confidence of 0.82; it was confirmed: 0.82" in text
    assert "The likeliest of the others was object 7" in text
    other = [msgspec.structs.replace(record.objects[1], label="vase")]
    failed = replace(record, status=msgspec.structs.replace(record.status, state="failed", found=False), verdict={})
    assert "turned out to be something else: vase." in " ".join(reasons(failed, other))
