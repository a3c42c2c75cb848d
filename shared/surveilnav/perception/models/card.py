"""The card of a built-in model: ``card.json`` beside its weights, written by whoever trained them."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surveilnav.errors import PerceptionError
from surveilnav.storage import atomic_write

NAME = "card.json"


class Measured(msgspec.Struct, frozen=True):
    """What a model found in one kind of view ("robot", "camera") that training never saw.

    Attributes:
        views: how many.
        ap50: mean average precision at an IoU of 0.5 over the six goals; of all classes that have objects.
        mask_iou: mean IoU of masks in true boxes.
        by_class: average precision.
        beside: by other detectors' names, their mean over the six goals on the same views.
    """

    views: int
    ap50: float
    ap50_all: float
    mask_iou: float
    by_class: dict[str, float] = {}
    beside: dict[str, float] = {}


class Card(msgspec.Struct, frozen=True):
    """What is known of a built-in model's weights.

    Attributes:
        sha256, bytes: of the weights' file.
        parameters: how many.
        steps, views_seen: of training; a view counts each time.
        measured: by kind of view.
        ms: processor milliseconds of one picture of 416 x 416, by detector.
    """

    sha256: str
    bytes: int
    parameters: int = 0
    steps: int = 0
    views_seen: int = 0
    measured: dict[str, Measured] = {}
    ms: dict[str, float] = {}


def card_of(weights: Path) -> Card | None:
    """The card beside a file of weights; None: there is none. PerceptionError: it can't be read."""
    path = weights.with_name(NAME)
    try:
        return msgspec.json.decode(path.read_bytes(), type=Card)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError, msgspec.DecodeError) as error:
        raise PerceptionError(f"{path} should be the card of {weights.name}, but can't be read: {error}") from error


def save_card(weights: Path, card: Card) -> None:
    """Writes the card beside a file of weights, whole or not at all. OSError: as the disk does."""
    with atomic_write(weights.with_name(NAME)) as file:
        file.write(msgspec.json.format(msgspec.json.encode(card), indent=1) + b"\n")
