"""Explaining a run: its page, its picture, and the same as numbers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from surveilnav.benchmark.explain.page import page
from surveilnav.benchmark.explain.picture import plot
from surveilnav.benchmark.explain.runs import ExplainableRun, Gain, gain_of
from surveilnav.errors import ConfigError
from surveilnav.storage import atomic_write


@dataclass(frozen=True, slots=True)
class Explained:
    """What was explained, and where it is written."""

    run: ExplainableRun
    gains: tuple[Gain, ...]
    page: Path
    picture: Path


def explain(folder: Path, bounds: Sequence[Path], out: Path | None = None) -> Explained:
    """Writes the page ``out`` and its picture beside it; None: beside the run's folder, under its name.

    Raises:
        ConfigError: a run isn't there or can't be explained, or the page can't be written; the message says what to do.
    """
    path = out or folder.resolve().with_name(f"{folder.resolve().name}.md")
    picture = path.with_suffix(".png")
    run = ExplainableRun.read(folder)
    gains = tuple(gain_of(ExplainableRun.read(bound), run) for bound in bounds)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(picture) as file:
            os.fchmod(file.fileno(), 0o644)
            plot(run, gains, file)
        with atomic_write(path) as file:
            os.fchmod(file.fileno(), 0o644)
            file.write(page(run, gains, picture.name).encode())
    except OSError as error:
        raise ConfigError(f"{path} can't be written: {error.strerror}; choose another --out") from error
    return Explained(run, gains, path, picture)
