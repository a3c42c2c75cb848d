"""Posterior probabilities of classes: against a literal copy of the formula, and by properties of any evidence."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.fusion.core.objects.config import PosteriorConfig
from surveilnav.services.fusion.core.objects.posterior import posterior
from surveilnav.services.fusion.core.objects.view_evidence import EvidenceByDirection, log_odds

C = PosteriorConfig()
directions = st.tuples(st.sampled_from(["robot", "camera"]), st.sampled_from(["0", "1", "2"]))
hits = st.tuples(directions, st.sampled_from(["bed", "chair", "tv"]), st.floats(0.02, 0.98))
stories = st.lists(hits, min_size=1, max_size=10)
misses = st.lists(directions, max_size=6)


def seen(story, missed=()) -> EvidenceByDirection:
    evidence = EvidenceByDirection()
    for direction, label, chance in story:
        evidence.add_detection(direction, label, chance)
    for direction in missed:
        evidence.add_miss(direction)
    return evidence


def chances_of(story, missed=(), config=C) -> dict[str, float]:
    return posterior(seen(story, missed).of_sources("robot", "camera"), config)


def literal(story, missed, label) -> float:
    """Log-odds of one class against something else, and its share of the detections."""
    places = sorted({d for d, _, _ in story} | set(missed))
    update = -math.log(C.repeat_odds)
    for place in places:
        mine = [p for d, name, p in story if d == place and name == label]
        by_name = [sum(d == place and name == other for d, name, _ in story) for other in ("bed", "chair", "tv")]
        n = max(by_name) + missed.count(place)
        update += (len(mine) * math.log(C.repeat_odds) + (n - len(mine)) * math.log(C.miss_odds)) / (
            1 + (n - 1) * C.correlation
        )
    prior = max(log_odds(p) for _, name, p in story if name == label)
    odds = math.exp(prior + update / (1 + (len(places) - 1) * C.correlation))
    return odds * sum(name == label for _, name, _ in story) / len(story)


@given(stories, misses)
def test_it_is_what_the_formula_says(story, missed):
    odds = {label: literal(story, missed, label) for label in {name for _, name, _ in story}}
    total = 1 + sum(odds.values())
    assert chances_of(story, missed) == pytest.approx({label: o / total for label, o in odds.items()})


@given(hits)
def test_after_one_detection_the_chance_is_its_own(hit):
    assert chances_of([hit]) == pytest.approx({hit[1]: hit[2]})


@given(stories, misses, st.randoms(use_true_random=False))
def test_order_is_nothing_and_all_are_shares_of_one(story, missed, random):
    shuffled = story[:]
    random.shuffle(shuffled)
    found = chances_of(story, missed)
    assert found == chances_of(shuffled, missed)
    assert all(0.0 < p < 1.0 for p in found.values())
    assert sum(found.values()) < 1.0


@given(stories, misses, st.floats(0.02, 0.98))
def test_a_surer_detection_never_speaks_against_and_a_miss_never_for(story, missed, chance):
    (direction, label, p), *rest = story
    less, more = (chances_of([(direction, label, q), *rest], missed)[label] for q in sorted((p, chance)))
    assert less <= more
    # where no other class could gain by it, from a direction that was looked from before: a new one makes all weigh less
    beds = [(d, "bed", q) for d, _, q in story]
    assert chances_of(beds, [*missed, direction])["bed"] <= chances_of(beds, missed)["bed"] + 1e-12


def test_views_from_one_direction_say_less_than_from_several():
    one = [(("robot", "0"), "bed", 0.6)]
    chances = [
        chances_of(one)["bed"],
        chances_of(one * 4)["bed"],
        chances_of([(("robot", str(i)), "bed", 0.6) for i in range(4)])["bed"],
    ]
    assert chances[0] < chances[1]
    assert chances_of(one * 4, config=PosteriorConfig(correlation=1.0))["bed"] == pytest.approx(0.6), "nothing new"
    independent = PosteriorConfig(correlation=0.0)
    assert math.isclose(
        log_odds(chances_of(one * 4, config=independent)["bed"]), log_odds(0.6) + 3 * math.log(C.repeat_odds)
    )


def test_what_is_called_one_thing_often_and_another_once_is_the_one():
    tvs = [(("robot", side), "tv", 0.6) for side in "012" for _ in range(9)]
    found = chances_of([*tvs, (("robot", "1"), "chair", 0.8)])
    assert found["tv"] > 3 * found["chair"]


def test_kinds_apart_and_as_plain_values():
    evidence = seen([(("camera", "a"), "bed", 0.6), (("robot", "2"), "chair", 0.9)], [("robot", "2")])
    assert set(posterior(evidence.of_sources("camera"), C)) == {"bed"}
    assert set(posterior(evidence.of_sources("robot"), C)) == {"chair"}
    assert posterior(evidence.of_sources(), C) == {}
    assert EvidenceByDirection.from_state(evidence.state()) == evidence


@given(stories, stories, misses)
def test_two_objects_that_become_one_are_as_if_they_had_been(a, b, missed):
    joined = seen(a)
    joined.absorb(seen(b, missed))
    assert posterior(joined.of_sources("robot", "camera"), C) == pytest.approx(chances_of([*a, *b], missed))


def test_more_directions_than_a_thing_has_are_no_news():
    evidence = seen([(("camera", str(i)), "bed", 0.6) for i in range(100)], [("camera", "99")])
    assert len(evidence) == 32
