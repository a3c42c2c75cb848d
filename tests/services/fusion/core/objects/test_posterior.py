"""Chances of classes: against the formula word by word, and by what must hold for any evidence."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.fusion.core.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.posterior import posterior
from surveilnav.services.fusion.core.objects.view_evidence import Looks, log_odds, of_kinds

C = PosteriorConfig()
directions = st.tuples(st.sampled_from(["robot", "camera"]), st.sampled_from(["0", "1", "2"]))
hits = st.tuples(directions, st.sampled_from(["bed", "chair", "tv"]), st.floats(0.02, 0.98))
stories = st.lists(hits, min_size=1, max_size=10)
misses = st.lists(directions, max_size=6)


def seen(story, missed=()) -> Looks:
    looks = Looks()
    for direction, label, chance in story:
        looks.hit(direction, label, chance)
    for direction in missed:
        looks.miss(direction)
    return looks


def of(story, missed=(), config=C) -> dict[str, float]:
    return posterior(of_kinds(seen(story, missed), "robot", "camera"), config)


def literal(story, missed, label) -> float:
    """Log-odds of one class against something else, and its share of the detections."""
    places = sorted({d for d, _, _ in story} | set(missed))
    said = -math.log(C.again)
    for place in places:
        mine = [p for d, name, p in story if d == place and name == label]
        by_name = [sum(d == place and name == other for d, name, _ in story) for other in ("bed", "chair", "tv")]
        n = max(by_name) + missed.count(place)
        said += (len(mine) * math.log(C.again) + (n - len(mine)) * math.log(C.missed)) / (1 + (n - 1) * C.alike)
    best = max(log_odds(p) for _, name, p in story if name == label)
    odds = math.exp(best + said / (1 + (len(places) - 1) * C.alike))
    return odds * sum(name == label for _, name, _ in story) / len(story)


@given(stories, misses)
def test_it_is_what_the_formula_says(story, missed):
    odds = {label: literal(story, missed, label) for label in {name for _, name, _ in story}}
    total = 1 + sum(odds.values())
    assert of(story, missed) == pytest.approx({label: o / total for label, o in odds.items()})


@given(hits)
def test_after_one_detection_the_chance_is_its_own(hit):
    assert of([hit]) == pytest.approx({hit[1]: hit[2]})


@given(stories, misses, st.randoms(use_true_random=False))
def test_order_is_nothing_and_all_are_shares_of_one(story, missed, random):
    shuffled = story[:]
    random.shuffle(shuffled)
    found = of(story, missed)
    assert found == of(shuffled, missed)
    assert all(0.0 < p < 1.0 for p in found.values())
    assert sum(found.values()) < 1.0


@given(stories, misses, st.floats(0.02, 0.98))
def test_a_surer_detection_never_speaks_against_and_a_miss_never_for(story, missed, chance):
    (direction, label, p), *rest = story
    less, more = (of([(direction, label, q), *rest], missed)[label] for q in sorted((p, chance)))
    assert less <= more
    # where no other class could gain by it, from a direction that was looked from before: a new one makes all weigh less
    beds = [(d, "bed", q) for d, _, q in story]
    assert of(beds, [*missed, direction])["bed"] <= of(beds, missed)["bed"] + 1e-12


def test_views_from_one_direction_say_less_than_from_several():
    one = [(("robot", "0"), "bed", 0.6)]
    chances = [of(one)["bed"], of(one * 4)["bed"], of([(("robot", str(i)), "bed", 0.6) for i in range(4)])["bed"]]
    assert chances[0] < chances[1]
    assert of(one * 4, config=PosteriorConfig(alike=1.0))["bed"] == pytest.approx(0.6), "nothing new"
    independent = PosteriorConfig(alike=0.0)
    assert math.isclose(log_odds(of(one * 4, config=independent)["bed"]), log_odds(0.6) + 3 * math.log(C.again))


def test_what_is_called_one_thing_often_and_another_once_is_the_one():
    tvs = [(("robot", side), "tv", 0.6) for side in "012" for _ in range(9)]
    found = of([*tvs, (("robot", "1"), "chair", 0.8)])
    assert found["tv"] > 3 * found["chair"]


def test_kinds_apart_and_as_plain_values():
    looks = seen([(("camera", "a"), "bed", 0.6), (("robot", "2"), "chair", 0.9)], [("robot", "2")])
    assert set(posterior(of_kinds(looks, "camera"), C)) == {"bed"}
    assert set(posterior(of_kinds(looks, "robot"), C)) == {"chair"}
    assert posterior(of_kinds(looks), C) == {}
    again = Looks.from_state(looks.state())
    assert again == looks


@given(stories, stories, misses)
def test_two_objects_that_become_one_are_as_if_they_had_been(a, b, missed):
    joined = seen(a)
    joined.absorb(seen(b, missed))
    assert posterior(of_kinds(joined, "robot", "camera"), C) == pytest.approx(of([*a, *b], missed))


def test_more_directions_than_a_thing_has_are_no_news():
    looks = seen([(("camera", str(i)), "bed", 0.6) for i in range(100)], [("camera", "99")])
    assert len(looks.of) == 32
