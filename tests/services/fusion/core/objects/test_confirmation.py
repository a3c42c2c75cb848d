"""Confirmation and rejection, by table."""

from __future__ import annotations

import pytest

from surveilnav.services.fusion.core import FusionConfig, ObjectConfig
from surveilnav.services.fusion.core.objects.config import ConfirmationConfig, PaperConfirmationConfig, PosteriorConfig
from surveilnav.services.fusion.core.objects.confirmation import confirmation_rule
from surveilnav.services.fusion.core.objects.evidence import Evidence

DEFAULT, PAPER = ObjectConfig(), FusionConfig.preset("paper").objects


def assessments_of(story, config, evidence=None):
    """Assesses after every word of a story: (kind, side, label, score = chance) or ("miss", side)."""
    rule, evidence, status, assessments = confirmation_rule(config), evidence or Evidence(), "candidate", []
    for kind, side, *seen in story:
        if kind == "miss":
            evidence.add_miss(("robot", side))
        else:
            label, chance = seen
            evidence.add_detection(label, chance, chance, (kind, side))
        rule.update(evidence)
        before = evidence.state()
        assessments.append(rule.assess(evidence, status))
        assert evidence.state() == before  # asking changes nothing
        status = assessments[-1].status
    return assessments


def robot(label, chance, sides="0"):
    return [("robot", side, label, chance) for side in sides]


def camera(label, chance, sides="a"):
    return [("camera", side, label, chance) for side in sides]


def misses(sides):
    return [("miss", side) for side in sides]


@pytest.mark.parametrize("word", ["bed", "chair", "fire extinguisher"])
@pytest.mark.parametrize(
    ("story", "status"),
    [
        (robot("X", 0.9), "confirmed"),  # it is worth what it is worth
        (robot("X", 0.8), "candidate"),
        (robot("X", 0.8, "00"), "candidate"),  # the same side says much the same
        (robot("X", 0.8, "01"), "confirmed"),  # seen again
        (robot("X", 0.6, "0" * 9), "candidate"),  # from one side always the same
        (robot("X", 0.75, "012345"), "confirmed"),
        (camera("X", 0.3), "candidate"),
        (camera("X", 0.95), "confirmed"),
        (camera("X", 0.95) + misses("0"), "confirmed"),
        (camera("X", 0.95) + misses("00112233"), "candidate"),
        (camera("X", 0.6) + robot("X", 0.8, "01"), "confirmed"),
        (robot("X", 0.06) + misses("1"), "rejected"),
        (robot("X", 0.04), "candidate"),  # nobody looked in vain yet
        (robot("X", 0.9, "00") + robot("Y", 0.9, "0011"), "candidate"),  # who knows
        (robot("X", 0.9, "001") + robot("Y", 0.3, "2"), "confirmed"),  # one weak other name
    ],
)
def test_our_rule_is_one_for_all_words(story, status, word):
    names = {"X": word, "Y": "couch"}
    renamed = [(kind, side, *(names.get(w, w) for w in rest)) for kind, side, *rest in story]
    last = assessments_of(renamed, DEFAULT)[-1]
    assert last.status == status, last.reason
    assert last.reason


def test_the_class_is_the_likeliest_at_any_time():
    assessments = assessments_of(robot("couch", 0.7, "00") + robot("bed", 0.95, "0123"), DEFAULT)
    assert [a.label for a in assessments] == ["couch", "couch", "bed", "bed", "bed", "bed"]
    assert assessments[-1].status == "confirmed", "nothing is settled for good"


def test_no_flicker_at_the_threshold():
    story, posterior = robot("tv", 0.89) + misses("0"), DEFAULT.confirmation.posterior
    for hysteresis, status in ((1.0, "candidate"), (0.8, "confirmed")):
        config = PosteriorConfig(hysteresis=hysteresis)
        assessments = assessments_of(story, ObjectConfig(confirmation=ConfirmationConfig(posterior=config)))
        assert [a.status for a in assessments] == ["confirmed", status]
        assert 0.8 * posterior.min_chance < assessments[-1].confidence < posterior.min_chance


@pytest.mark.parametrize(
    ("story", "label", "status"),
    [
        (robot("couch", 0.9), "couch", "candidate"),  # one detection is none (VLN-Game)
        (robot("couch", 0.6, "00"), "couch", "confirmed"),
        (camera("couch", 0.6, "aa"), "couch", "confirmed"),
        (robot("couch", 0.4, "00"), "couch", "candidate"),
        (camera("couch", 0.6, "aa") + robot("bed", 0.5), "couch", "confirmed"),  # the maximum is still the camera's
        (camera("couch", 0.6) + robot("bed", 0.7), "bed", "rejected"),
        (camera("couch", 0.6) + robot("bed", 0.7, "00000000000000000000"), "bed", "rejected"),  # for good
        (robot("couch", 0.6, "00") + misses("0" * 50), "couch", "confirmed"),  # the paper knows no negative evidence
    ],
)
def test_the_paper_to_the_letter(story, label, status):
    last = assessments_of(story, PAPER)[-1]
    assert (last.label, last.status) == (label, status), last.reason


def test_absorbing_adds_up():
    a, b = Evidence(), Evidence()
    assessments_of(robot("couch", 0.8, "00") + misses("1"), DEFAULT, a)
    assessments_of(robot("couch", 0.6, "00") + camera("bed", 0.5) + misses("12"), DEFAULT, b)
    a.absorb(b)
    assert (a.misses, a.count("couch"), a.count("bed"), a.robot["couch"].n) == (3, 4, 1, 4)
    assert a.robot["couch"].total == pytest.approx(2 * 0.8 + 2 * 0.6)
    assert a.by_direction.views["robot", "1"].misses == 2
    assert Evidence.from_state(a.state()).state() == a.state()


def test_without_flips_a_sure_detection_is_believed_whatever_comes_later():
    """What the baselines believe: one detection above the threshold, and a change of class is none."""
    rule = ConfirmationConfig(rule="paper", paper=PaperConfirmationConfig(min_detections=1, flip_rejects=False))
    story = robot("couch", 0.6) + robot("bed", 0.9) + misses("0" * 9)
    assessments = assessments_of(story, ObjectConfig(confirmation=rule))
    assert [(a.label, a.status) for a in assessments[:2]] == [("couch", "confirmed"), ("bed", "confirmed")]
    assert {a.status for a in assessments} == {"confirmed"}


@pytest.mark.parametrize(
    ("config", "score", "chance", "status"),
    [
        (PAPER, 0.9, 0.1, "confirmed"),
        (PAPER, 0.1, 0.98, "candidate"),
        (DEFAULT, 0.9, 0.1, "candidate"),
        (DEFAULT, 0.1, 0.98, "confirmed"),
    ],
)
def test_the_paper_weighs_scores_and_our_rule_chances(config, score, chance, status):
    rule, evidence = confirmation_rule(config), Evidence()
    for side in "0123":
        evidence.add_detection("X", score, chance, ("robot", side))
    rule.update(evidence)
    assert rule.assess(evidence, "candidate").status == status
