"""What fusion has detectors look for: the targets of open missions, and a standing list."""

from __future__ import annotations

import pytest

from surveilnav.contract import MISSION_STATUS
from surveilnav.messages import MissionStatus
from surveilnav.services.fusion.intake.camera_searches import CameraSearches
from surveilnav.services.fusion.intake.pictures import PictureCache
from surveilnav.services.fusion.intake.words import SearchedWords
from surveilnav.words import MAX_WORDS
from tests.waiting import until


def status(mission, target, state="active"):
    return MissionStatus(
        stamp_ns=1, mission=mission, target=target, robot="r", state=state, phase="", step=0, max_steps=9, path_m=0.0
    )


@pytest.fixture
def tell(make_node):
    """``tell(mission, target, state)``, as a planner does."""
    planner = make_node("planner", "p")
    publishers = {}

    def tell(mission, target, state="active"):
        publisher = publishers.setdefault(mission, planner.publisher(MISSION_STATUS, mission=mission))
        publisher.put(status(mission, target, state))

    return tell


def test_words_are_those_of_open_missions_and_the_standing_list(make_node, tell):
    words = SearchedWords(make_node("fusion", "f"), ["Sofa", "?!", "person"], CameraSearches())
    assert words.current() == ("couch", "person"), "one spelling; what is no word is left out"
    tell("m1", "samovar")
    tell("m2", "couch")
    until(lambda: words.current() == ("couch", "person", "samovar"))
    tell("m1", "samovar", "done")
    until(lambda: words.current() == ("couch", "person"))


def test_a_hundred_missions_for_one_thing_leave_room_for_another(make_node, tell):
    words = SearchedWords(make_node("fusion", "f"), [f"thing {n}" for n in range(MAX_WORDS)], CameraSearches())
    for n in range(100):
        tell(f"m{n}", "chair")
    tell("last", "samovar")
    until(lambda: "samovar" in words.current())
    assert len(words.current()) == MAX_WORDS
    assert "chair" in words.current()


def test_missions_of_a_planner_that_is_gone_are_not_searched_for(make_node):
    planner, words = make_node("planner", "p"), SearchedWords(make_node("fusion", "f"), (), CameraSearches())
    planner.publisher(MISSION_STATUS, mission="m").put(status("m", "samovar"))
    until(lambda: words.current() == ("samovar",))
    planner.__exit__(None, None, None)
    until(lambda: words.current() == ())


class Frame:
    def __init__(self, source, view, n_bytes):
        self.message, self.payload = type("Header", (), {"source": source, "view": view}), bytes(n_bytes)


def test_the_newest_pictures_of_cameras_are_cache_within_their_bytes():
    cache = PictureCache(100)
    for frame in (
        Frame("camera/a", 0, 40),
        Frame("camera/a", 1, 40),
        Frame("robot/r", 0, 40),
        Frame("camera/a", 0, 30),
    ):
        cache.put(frame)
    assert [(f.message.view, len(f.payload)) for f in cache.frames()] == [(1, 40), (0, 30)]
    cache.put(Frame("camera/b", 0, 35))
    assert [f.message.source for f in cache.frames()] == ["camera/a", "camera/b"]
    cache.drop_source("camera/a")
    assert [f.message.source for f in cache.frames()] == ["camera/b"]


def test_what_a_search_with_cameras_looks_for_is_looked_for_while_it_is_open(make_node):
    searches = CameraSearches()
    words = SearchedWords(make_node("fusion", "f"), ["person"], searches)
    with searches.open("samovar", None):
        assert words.current() == ("person", "samovar")
        assert not words.is_idle
    assert words.current() == ("person",)
    assert words.is_idle
