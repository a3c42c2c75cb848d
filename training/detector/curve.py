"""The curve of a training: a table and a picture."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

_PARTS = ("loss", "score", "box", "mask", "near", "room")


def draw_curve(table: Path, picture: Path) -> None:
    """Draws the parts of the loss over steps."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        return
    steps = np.array([int(row["step"]) for row in rows])
    figure, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
    for part in _PARTS:
        values = np.array([float(row[part]) for row in rows])
        axes.plot(steps, values, label=part, linewidth=2.0 if part == "loss" else 1.0)
    axes.set(xlabel="step", ylabel="loss", yscale="log")
    axes.legend(ncols=3, frameon=False)
    axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=120)
    pyplot.close(figure)
