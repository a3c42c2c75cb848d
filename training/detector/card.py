"""The model card of ``compact``: prose, and the numbers that lie beside its weights in the package.

    python -m training.detector.card > docs/understand/compact.md

``python -m training.detector.export`` writes ``card.json`` beside the weights, ``evaluate --card`` adds what they find.
"""

from __future__ import annotations

from collections.abc import Iterator

from surveilnav.perception import models
from surveilnav.perception.models.card import Card, Measured
from surveilnav.simulator.world.labels import TARGETS
from training.detector import classes

_KINDS = {"robot": "robot views", "camera": "camera views"}

_PAGE = """# The model `compact`

One small network of our own finds things, cuts them out, and says how near a picture is to a word. It sees colour and depth.
It comes with the package, so that a clone without a network has real eyes. `auto` takes it in simulated
buildings, and where `onnx-coco` can't be had.
`make docs` writes this page.

## What it knows

| | |
|---|---|
| {n_classes} classes | {classes} |
| {n_rooms} kinds of rooms, for the value of a view | {rooms} |

People's words for the classes are understood in 19 languages ("Fernseher", "canapé", "床"). Other words are refused, with the
names that come nearest.

## The weights

{weights}

## What it finds

{measured}

## What it learnt from

- **Renders alone**: our own renderer's views of the buildings of dataset v2's split `train`, with `train`'s half of the furniture
  models. Heights, tilts and fields of view are those of robots and cameras.
- **Nothing else**: training starts from random weights. No photograph had a part, and no other model's weights or answers.
- Labels are the renderer's own: what each pixel shows. [How it is trained](../../training/detector/README.md) has every command.
- Held out: `val`'s plans, seeds and half of the furniture models. They were rendered for evaluation only. The
  numbers above are of seven of its buildings. The size of pictures and the last of the weights were chosen by them, too.

## Limits

- **Rendered homes, not photographs.** On photographs nobody should expect much; `onnx-coco` learnt from those.
- **It leans on depth**: on sizes, heights and slopes of surfaces. One training view in twenty had none. Depth came with the
  simulator's noise, from sensors that reach 5 m (robots) and 10 m (cameras).
- It knows our furniture libraries' taste: European homes of about 2010, offices and flats made of the same pieces.
- Things that show fewer than 24 pixels in a training view weren't objects. Far, thin and cut things are found least.
- Its chances hold for rendered buildings with `train`'s furniture; elsewhere they are a guess.
- It isn't made to find, count or tell apart people. `person` stands for the figures in the libraries.

## Credits

Other people made the furniture and homes that were rendered: Emmanuel and Véronique Puybaret (eTeks), Scopia, Andrew Kator and
Jennifer Legaz, Reallusion, and the contributors of Blend Swap. [CREDITS.md](../../CREDITS.md) has each with its licence: CC BY
3.0, CC0 or the GNU GPL. None of their files are in this repository. The weights are SurveilNav's own,
under the Apache License 2.0.
"""


def page(card: Card | None) -> str:
    """The page, in Markdown; without a card it says that there are no weights yet."""
    names = classes.load()
    return _PAGE.format(
        n_classes=len(names.names),
        classes=", ".join(names.names),
        n_rooms=len(names.rooms),
        rooms=", ".join(names.rooms),
        weights=_weights(card),
        measured="\n".join(_measured(card)),
    )


def _weights(card: Card | None) -> str:
    if card is None:
        return "They aren't in the package yet: until they are, `auto` takes `onnx-coco`, or the simulated stand-in."
    return (
        f"`compact/compact.onnx`: {card.parameters / 1e6:.2f} M parameters, {card.bytes / 1e6:.2f} MB, sha256 `{card.sha256}`. "
        f"Trained in {card.steps:,} steps, on {card.views_seen:,} views (a view counts each time)."
    )


def _measured(card: Card | None) -> Iterator[str]:
    if card is None or not card.measured:
        yield "Not measured yet: `python -m training.detector.evaluate --card` does."
        return
    yield "AP50 on rendered views of `val`, as sensors take them; mask IoU in true boxes."
    yield ""
    yield "| views | how many | the six goals | all classes | mask IoU | others on the six goals |"
    yield "|---|---|---|---|---|---|"
    for kind, title in _KINDS.items():
        if (found := card.measured.get(kind)) is not None:
            others = ", ".join(f"`{name}` {ap:.2f}" for name, ap in found.beside.items())
            yield f"| {title} | {found.views} | {found.ap50:.2f} | {found.ap50_all:.2f} | {found.mask_iou:.2f} | {others} |"
    yield ""
    yield from _by_class(card.measured)
    if card.ms:
        times = ", ".join(f"`{name}` {ms:.1f} ms" for name, ms in card.ms.items())
        yield ""
        yield f"Processor time of one picture of 416 × 416 pixels, in one run: {times}."


def _by_class(measured: dict[str, Measured]) -> Iterator[str]:
    """A row for each goal, then one for the other classes that have objects."""
    kinds = [kind for kind in _KINDS if kind in measured]
    yield "| class |" + "".join(f" {_KINDS[kind]} |" for kind in kinds)
    yield "|---|" + "---|" * len(kinds)
    others = dict.fromkeys(name for kind in kinds for name in measured[kind].by_class if name not in TARGETS)
    for name in (*TARGETS, *others):
        cells = (measured[kind].by_class.get(name) for kind in kinds)
        yield f"| {name} |" + "".join(f" {'' if ap is None else f'{ap:.2f}'} |" for ap in cells)


def main() -> None:
    """See the module's docstring."""
    path = models.model_called("compact").built_in_path
    print(page(models.card_of(path) if path.exists() else None), end="")


if __name__ == "__main__":
    main()
