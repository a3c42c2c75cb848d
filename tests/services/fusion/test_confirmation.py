"""Confirmation and rejection, by table."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.fusion.core import FusionConfig, ObjectConfig
from services.fusion.core.config import (
    ConfirmationConfig,
    EvidenceConfirmationConfig,
    PaperConfirmationConfig,
    PosteriorConfig,
)
from services.fusion.core.confirmation import confirmation_of
from services.fusion.core.evidence import Evidence
from services.fusion.core.posterior_confirmation import PosteriorConfirmation

DEFAULT, PAPER = ObjectConfig(), FusionConfig.preset("paper").objects


def told(story, config, evidence=None):
    """Assesses after every word of a story: ("robot" | "far" | "camera", label, score) or "miss"."""
    rule, evidence, status, assessments = confirmation_of(config), evidence or Evidence(), "candidate", []
    for i, word in enumerate(story):
        if word == "miss":
            evidence.misses += 1
        else:
            who, label, score = word
            weight = 0.3 if who == "far" else 1.0
            evidence.add(label, score, weight=weight, near=who == "robot", place=(who, i), is_robot=who != "camera")
        rule.settle(evidence)
        before = evidence.state()
        assessments.append(rule.assess(evidence, status))
        assert evidence.state() == before  # asking changes nothing
        status = assessments[-1].status
    return assessments


def near(label, score, n=1):
    return [("robot", label, score)] * n


def camera(label, score, n=1):
    return [("camera", label, score)] * n


@pytest.mark.parametrize(
    ("story", "label", "status"),
    [
        (near("couch", 0.9), "couch", "candidate"),
        (near("couch", 0.9, 3), "couch", "confirmed"),
        (near("chair", 0.28, 9), "chair", "candidate"),
        (near("tv", 0.45, 9), "tv", "confirmed"),  # seldom seen wrongly: less is enough
        (near("tv", 0.36, 9), "tv", "candidate"),
        (near("bed", 0.36, 9), "bed", "candidate"),
        (near("bed", 0.7, 5), "bed", "candidate"),  # much looks like a bed at first
        (near("chair", 0.34, 3), "chair", "candidate"),  # a few views agree by chance
        (near("chair", 0.34, 9), "chair", "confirmed"),
        (near("bed", 0.55, 9), "bed", "confirmed"),
        ([("far", "couch", 0.9)] * 9, "couch", "candidate"),
        (camera("couch", 0.8, 2), "couch", "candidate"),
        (camera("couch", 0.8, 3), "couch", "confirmed"),
        (camera("couch", 0.6, 9), "couch", "candidate"),
        (camera("couch", 0.6, 2) + near("couch", 0.7), "couch", "confirmed"),
        (near("couch", 0.8, 5) + near("bed", 0.9), "couch", "confirmed"),  # one weak flip
        (near("chair", 0.78, 4) + near("bed", 0.7, 4), "chair", "candidate"),  # who knows
        (near("couch", 0.7, 4) + near("bed", 0.6, 4), "couch", "confirmed"),  # mostly a couch is enough
        (near("couch", 0.8, 3) + near("bed", 0.9, 4), "bed", "rejected"),  # a flip
        (near("couch", 0.8, 3) + near("bed", 0.9, 12), "bed", "candidate"),  # beds aren't taken for couches
        (near("couch", 0.8, 3) + near("bed", 0.9, 16), "bed", "confirmed"),  # it is a bed after all
        (near("chair", 0.8, 2) + ["miss"] * 6, "chair", "rejected"),
        (near("chair", 0.8, 8) + ["miss"] * 6, "chair", "confirmed"),
        (camera("chair", 0.8, 3) + ["miss"] * 2, "chair", "confirmed"),
        (camera("chair", 0.8, 3) + ["miss"] * 5, "chair", "candidate"),
        (near("couch", 0.8, 3) + ["miss"] * 6, "couch", "rejected"),
        (near("potted plant", 0.8, 3) + ["miss"] * 6, "potted plant", "confirmed"),  # often missed: says little
        (near("potted plant", 0.8) + ["miss"] * 6, "potted plant", "rejected"),
    ],
)
def test_our_rule(story, label, status):
    last = told(story, DEFAULT)[-1]
    assert (last.label, last.status) == (label, status), last.reason
    assert last.reason


def test_confidence_is_the_larger_of_both_and_the_class_is_its_class():
    last = told(camera("chair", 0.6) + near("couch", 0.8), DEFAULT)[-1]
    assert (last.label, last.confidence) == ("couch", pytest.approx(0.8))


@pytest.mark.parametrize(
    ("story", "label", "status"),
    [
        (near("couch", 0.9), "couch", "candidate"),  # one detection is none (VLN-Game)
        (near("couch", 0.6, 2), "couch", "confirmed"),
        (camera("couch", 0.6, 2), "couch", "confirmed"),
        (near("couch", 0.4, 2), "couch", "candidate"),
        (camera("couch", 0.6, 2) + near("bed", 0.5), "couch", "confirmed"),  # the maximum is still the camera's
        (camera("couch", 0.6) + near("bed", 0.7), "bed", "rejected"),
        (camera("couch", 0.6) + near("bed", 0.7, 20), "bed", "rejected"),  # for good
        (near("couch", 0.6, 2) + ["miss"] * 50, "couch", "confirmed"),  # the paper knows no negative evidence
    ],
)
def test_the_paper_to_the_letter(story, label, status):
    last = told(story, PAPER)[-1]
    assert (last.label, last.status) == (label, status), last.reason


def test_few_detections_confirm_nothing_however_sure_they_are():
    evidence = EvidenceConfirmationConfig(min_detections=4, camera_views=1)
    config = ObjectConfig(confirmation=ConfirmationConfig(evidence=evidence))
    assessments = told(camera("couch", 0.95, 2) + near("couch", 0.95, 2), config)
    assert [a.status for a in assessments] == ["candidate"] * 3 + ["confirmed"]
    assert assessments[0].reason == "1 of at least 4 detections of a couch"


def test_confidence_by_share_against_a_literal_sum():
    story = near("couch", 0.9, 2) + near("chair", 0.5, 1) + ["miss"] * 2
    evidence = Evidence()
    told(story, DEFAULT, evidence)
    weight = 3 + 2 * DEFAULT.false_positives.miss_weight
    assert confirmation_of(DEFAULT).confidences(evidence).robot["couch"] == pytest.approx((0.9 + 0.9) / weight)


def test_no_flicker_at_the_threshold():
    assessments = told(near("couch", 0.52, 3) + near("couch", 0.3, 1), DEFAULT)
    assert [a.status for a in assessments[-2:]] == ["confirmed", "confirmed"]
    assert assessments[-1].confidence < DEFAULT.confirmation.evidence.min_confidence


def test_absorbing_adds_up():
    a, b = Evidence(misses=1), Evidence(misses=2)
    told(near("couch", 0.8, 2), DEFAULT, a)
    told(near("couch", 0.6, 2) + camera("bed", 0.5), DEFAULT, b)
    a.absorb(b)
    assert (a.misses, a.count("couch"), a.count("bed"), a.robot["couch"].near) == (3, 4, 1, 4)
    assert a.robot["couch"].weighted_score == pytest.approx(2 * 0.8 + 2 * 0.6)


def test_without_flips_a_sure_detection_is_believed_whatever_comes_later():
    """What the baselines believe: one detection above the threshold, and a change of class is none."""
    rule = ConfirmationConfig(rule="paper", paper=PaperConfirmationConfig(min_detections=1, flip_rejects=False))
    story = near("couch", 0.6) + near("bed", 0.9) + ["miss"] * 9
    assessments = told(story, ObjectConfig(confirmation=rule))
    assert [(a.label, a.status) for a in assessments[:2]] == [("couch", "confirmed"), ("bed", "confirmed")]
    assert {a.status for a in assessments} == {"confirmed"}


@pytest.mark.parametrize(
    ("config", "range_m", "is_robot", "weight", "near"),
    [
        (DEFAULT, 3.5, True, 1.0, True),
        (DEFAULT, 7.0, True, 0.25, False),
        (DEFAULT, 0.0, True, 1.0, True),
        (DEFAULT, 1.0, False, 1.0, False),
        (PAPER, 70.0, True, 1.0, True),  # the paper knows no range
        (PAPER, 1.0, False, 1.0, False),
    ],
)
def test_detections_weigh_less_from_afar(config, range_m, is_robot, weight, near):
    assert confirmation_of(config).weigh(range_m, is_robot=is_robot) == (weight, near)


def test_one_rule_for_all_knows_no_classes():
    one_rule = EvidenceConfirmationConfig(class_priors=False)
    config = ObjectConfig(confirmation=ConfirmationConfig(evidence=one_rule))
    for story in (near("tv", 0.45, 9), near("chair", 0.34, 9)):
        assert told(story, DEFAULT)[-1].status == "confirmed"
        assert told(story, config)[-1].status == "candidate"
    assert told(near("bed", 0.7, 5), config)[-1].status == "confirmed"


# --- one chance for all words ---------------------------------------------------------------------------------------

POSTERIOR = ObjectConfig(confirmation=ConfirmationConfig(rule="posterior"))
RULE = PosteriorConfirmation(PosteriorConfig())


def seen(*views, misses=0):
    """Evidence of (who, label, chance, place) views."""
    evidence = Evidence(misses=misses)
    for who, label, chance, place in views:
        evidence.add(
            label, 0.5, weight=1.0, near=who == "robot", place=(who, place), is_robot=who != "camera", chance=chance
        )
    return evidence


def literal_chance(views, misses, label, c):
    """The formula, word by word."""
    by_place = {}
    for who, name, chance, place in views:
        odds = math.log(chance / (1 - chance))
        by_place[who, place, name] = max(odds, by_place.get((who, place, name), -99.0))
    mine = [odds for (_, _, name), odds in by_place.items() if name == label]
    n_others = sum(name != label for _, _, name in by_place)
    z = c.even + c.mean * sum(mine) / len(mine) + c.best * max(mine)
    z += (c.more + c.more_mean * sum(mine) / len(mine)) * math.log(len(mine))
    z += c.seen_by_camera if any(who == "camera" and name == label for who, _, name in by_place) else 0.0
    z -= c.others * math.log(1 + n_others) + c.misses * math.sqrt(misses)
    return 1 / (1 + math.exp(-z))


view = st.tuples(
    st.sampled_from(["robot", "far", "camera"]),
    st.sampled_from(["bed", "couch", "tv"]),
    st.floats(0.05, 0.95),
    st.integers(0, 4),
)


@given(views=st.lists(view, min_size=1, max_size=12), misses=st.integers(0, 9), order=st.randoms(use_true_random=False))
def test_a_chance_is_what_the_formula_says_in_any_order(views, misses, order):
    shuffled = views[:]
    order.shuffle(shuffled)
    one, other = seen(*views, misses=misses), seen(*shuffled, misses=misses)
    for label in {name for _, name, _, _ in views}:
        assert RULE.chance(one, label) == pytest.approx(literal_chance(views, misses, label, PosteriorConfig()))
        assert RULE.chance(other, label) == pytest.approx(RULE.chance(one, label))
        assert 0.0 < RULE.chance(one, label) < 1.0
    assert RULE.chance(one, "unicorn") == 0.0
    assert Evidence.of_state(one.state()).state() == one.state()


def test_more_places_and_surer_ones_speak_for_it_misses_and_other_names_against():
    bed = [("robot", "bed", 0.6, place) for place in range(3)]
    chance = RULE.chance(seen(*bed), "bed")
    assert RULE.chance(seen(*bed, ("robot", "bed", 0.6, 9)), "bed") > chance
    assert RULE.chance(seen(*bed, ("robot", "bed", 0.9, 0)), "bed") > chance
    assert RULE.chance(seen(*bed, ("robot", "bed", 0.6, 0)), "bed") == chance, "the same view again says nothing"
    assert RULE.chance(seen(*bed, misses=1), "bed") < chance
    assert RULE.chance(seen(*bed, ("robot", "couch", 0.6, 9)), "bed") < chance


def test_one_threshold_confirms_any_word():
    for label in ("bed", "tv", "fire extinguisher"):
        rule, sure = confirmation_of(POSTERIOR), [("robot", label, 0.9, place) for place in range(6)]
        evidence = seen(*sure)
        rule.settle(evidence)
        assert rule.assess(evidence, "candidate").status == "confirmed"
        far = seen(*(("far", *rest) for _, *rest in sure))
        rule.settle(far)
        assert rule.assess(far, "candidate").status == "candidate"
        lost = seen(("robot", label, 0.3, 0), misses=9)
        rule.settle(lost)
        assert rule.assess(lost, "candidate").status == "rejected"
