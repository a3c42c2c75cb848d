"""What is known of the depth network's weights: ``card.json`` beside them."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surveilnav.storage import atomic_write

NAME = "card.json"


class Band(msgspec.Struct, frozen=True):
    """Errors of depth in a band of true depths, as shares of it.

    Attributes:
        nearest_m, farthest_m: of the band.
        median, p90: of the network's relative errors.
        median_off_floor: median error of the pixels that don't show the floor.
        reference_median, reference_p90, reference_median_off_floor: the same of the reference depth, that of an empty room.
        unknown: share of pixels whose depth the network leaves unknown; they don't count in its errors.
    """

    nearest_m: float
    farthest_m: float
    median: float
    p90: float
    median_off_floor: float
    reference_median: float
    reference_p90: float
    reference_median_off_floor: float
    unknown: float


class Floor(msgspec.Struct, frozen=True):
    """Where depth is within 3 % of the floor's.

    Attributes:
        recall: of pixels that show the floor.
        false_share: of pixels that show something else in front of the floor. ``false_share_above_10_cm``: something higher.
        precision: share of floor among what was taken for it.
    """

    recall: float
    precision: float
    false_share: float
    false_share_above_10_cm: float


class Measured(msgspec.Struct, frozen=True):
    """What was found on views of buildings that training never saw.

    Attributes:
        views: how many.
        bands: by true depth.
        floor: where the floor was found.
        within_1_sigma, within_2_sigma: shares of errors, of pixels that weren't taken for floor, in buildings that weren't used
            for fitting.
    """

    views: int
    bands: list[Band]
    floor: Floor
    within_1_sigma: float
    within_2_sigma: float


class Card(msgspec.Struct, frozen=True):
    """What is known of the weights.

    Attributes:
        sha256, bytes: of the file.
        parameters: how many.
        steps, views_seen: of training; a view counts each time.
        sigma_factor: that the network's own uncertainty was multiplied by.
        ms: of one view on one core.
        measured: with the exact calibration, and "imprecise".
    """

    sha256: str
    bytes: int
    parameters: int
    steps: int
    views_seen: int
    sigma_factor: float
    ms: float = 0.0
    measured: dict[str, Measured] = {}


def card_of(weights: Path) -> Card:
    """The card beside a file of weights. OSError, msgspec.DecodeError: there is none."""
    return msgspec.json.decode(weights.with_name(NAME).read_bytes(), type=Card)


def save_card(weights: Path, card: Card) -> None:
    """Writes the card beside a file of weights, atomically."""
    with atomic_write(weights.with_name(NAME)) as file:
        file.write(msgspec.json.format(msgspec.json.encode(card), indent=1) + b"\n")
