"""Trains ``compact`` on packed views; resumes where it was after any interruption.

    python -m training.detector.train --views data/views/train ... --out runs/compact --steps 20000

``--out`` holds ``checkpoint.pt`` (written every few minutes, whole or not there) and ``curve.csv``. A step's
views and their variations depend on the seed and the step alone, so a resumed run is the run that was never interrupted.
"""

from __future__ import annotations

import argparse
import copy
import csv
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from surveilnav.storage import atomic_write
from training.detector import classes
from training.detector.assign import Targets
from training.detector.data import Views
from training.detector.losses import WEIGHTS, Batch, losses
from training.detector.network import Compact, Shape, places
from training.detector.pack import read_packs
from training.learning import blend, cosine_rate, n_parameters, weight_groups


@dataclass(frozen=True, slots=True)
class Plan:
    """How it is trained.

    Attributes:
        steps: in all; ``batch``: views a step.
        rate: highest learning rate, reached after ``warm_up`` steps; a half cosine takes it to ``last`` of that.
        decay: of weights.
        seed: of weights, views and variations.
        checkpoint_s: seconds between checkpoints; ``log_every``: steps between lines of the curve.
        bf16: whether convolutions are computed in bfloat16.
        workers: processes that make batches; 1: a thread beside the network.
    """

    steps: int
    batch: int = 16
    rate: float = 2e-3
    last: float = 0.02
    warm_up: int = 100
    decay: float = 0.02
    seed: int = 0
    checkpoint_s: float = 180.0
    log_every: int = 20
    bf16: bool = False
    workers: int = 1

    def rate_at(self, step: int) -> float:
        return cosine_rate(step, steps=self.steps, rate=self.rate, warm_up=self.warm_up, last=self.last)

    def keeps_at(self, step: int) -> float:
        """The share of the mean of weights that stays at a step; the current weights are the rest.

        The mean spans a fiftieth of the run, and less at its beginning.
        """
        return min(1.0 - min(0.5, 50.0 / self.steps), (1.0 + step) / (10.0 + step))


class Training:
    """A run in progress. ``network`` learns, ``mean`` is the mean of its weights, which is what is used."""

    def __init__(
        self,
        plan: Plan,
        views: Views,
        out: Path,
        shape: Shape | None = None,
        device: str = "cpu",
        start: Path | None = None,
    ) -> None:
        """``start``: a checkpoint of another run, whose mean of weights this one begins with, if it hasn't begun yet."""
        torch.manual_seed(plan.seed)
        names = classes.load()
        self.plan, self.views, self.out, self.step = plan, views, out, 0
        self.steps_before = 0
        self.device = torch.device(device)
        self.shape = shape or Shape()
        network = Compact(len(names.names), len(names.rooms), self.shape)
        if start is not None:
            begun = torch.load(start, map_location="cpu", weights_only=True)
            network.load_state_dict(begun["mean"])
            self.steps_before = steps_of(begun)
        self.network = network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.mean = copy.deepcopy(self.network).eval().requires_grad_(False)
        self.optimiser = torch.optim.AdamW(weight_groups(self.network, plan.decay), lr=plan.rate)
        self._resume()

    @property
    def checkpoint(self) -> Path:
        return self.out / "checkpoint.pt"

    def _resume(self) -> None:
        if not self.checkpoint.exists():
            return
        kept = torch.load(self.checkpoint, map_location=self.device, weights_only=True)
        self.step, self.steps_before = kept["step"], kept.get("steps_before", 0)
        self.network.load_state_dict(kept["network"])
        self.mean.load_state_dict(kept["mean"])
        self.optimiser.load_state_dict(kept["optimiser"])

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all."""
        kept = {
            "step": self.step,
            "steps_before": self.steps_before,
            "shape": asdict(self.shape),
            "network": self.network.state_dict(),
            "mean": self.mean.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        with atomic_write(self.checkpoint) as file:
            torch.save(kept, file)

    def run(self, until: int | None = None) -> None:
        """Trains to the end of the plan, or to step ``until``; saves at the end and in between."""
        last = min(self.plan.steps, until if until is not None else self.plan.steps)
        begun, first, saved = time.perf_counter(), self.step, time.perf_counter()
        with _curve(self.out / "curve.csv", self.step) as write:
            sums: dict[str, float] = {}
            for batch in self.views.batches(self.step, last, self.plan.batch, self.plan.workers):
                for name, value in self.one_step(batch).items():
                    sums[name] = sums.get(name, 0.0) + value
                if self.step % self.plan.log_every == 0 or self.step == last:
                    n = (self.step - 1) % self.plan.log_every + 1
                    pace = (time.perf_counter() - begun) / (self.step - first)
                    write(self.step, {name: total / n for name, total in sums.items()}, pace / self.plan.batch)
                    left = pace * (last - self.step)
                    print(
                        f"step {self.step} of {last}, loss {sums['loss'] / n:.3f}, {left / 60:.0f} min left", flush=True
                    )
                    sums = {}
                if time.perf_counter() - saved > self.plan.checkpoint_s:
                    self.save()
                    saved = time.perf_counter()
        self.save()

    def one_step(self, batch: Batch) -> dict[str, float]:
        """One step of learning; the parts of the loss, and their sum as "loss"."""
        batch = _moved(batch, self.device)
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate_at(self.step)
        self.network.train()
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.plan.bf16):
            predicted = self.network(batch.pictures.float() / 255.0, batch.depth)
        points, _ = places(batch.pictures.shape[2], batch.pictures.shape[3], self.device)
        parts = losses(predicted, points, batch)
        loss = torch.stack([WEIGHTS[name] * part for name, part in parts.items()]).sum()
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), 10.0)
        self.optimiser.step()
        blend(self.mean, self.network, self.plan.keeps_at(self.step))
        self.step += 1
        return {name: float(part.detach()) for name, part in {**parts, "loss": loss}.items()}


def steps_of(kept: dict[str, Any]) -> int:
    """All steps that made a checkpoint's weights, those of the run that it began with among them."""
    return int(kept["step"]) + int(kept.get("steps_before", 0))


def _moved(batch: Batch, device: torch.device) -> Batch:
    def to(x: Tensor) -> Tensor:
        return x.to(device, non_blocking=True)

    t = batch.targets
    return Batch(
        to(batch.pictures),
        to(batch.depth),
        to(batch.ids),
        Targets(to(t.boxes), to(t.labels), to(t.real)),
        to(batch.near),
        to(batch.room),
    )


_PARTS = (*WEIGHTS, "loss")


@contextmanager
def _curve(path: Path, step: int) -> Iterator[Any]:
    """Appends lines to the curve; those after ``step``, of a run that was killed, are dropped first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = ["step", *_PARTS, "s_per_view"]
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))[1:] if path.exists() else []
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerows([head, *(row for row in rows if int(row[0]) <= step)])

        def write(at: int, parts: dict[str, float], s_per_view: float) -> None:
            writer.writerow([at, *(f"{parts[name]:.4f}" for name in _PARTS), f"{s_per_view:.4f}"])
            file.flush()

        yield write


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.detector.train", description=__doc__.partition("\n")[0])
    parser.add_argument("--views", type=Path, nargs="+", required=True, help="folders of packs")
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument(
        "--small-share", type=float, default=0.6, help="of the steps, on small canvases, which cost half"
    )
    parser.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--workers", type=int, default=1, help="processes that make batches; 1: a thread")
    parser.add_argument("--bf16", action="store_true", help="convolutions in bfloat16")
    parser.add_argument("--start", type=Path, help="a checkpoint of another run, whose weights this one begins with")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    args = parser.parse_args(argv)
    torch.set_num_threads(args.threads)
    packs = [pack for folder in args.views for pack in read_packs(folder, classes.load().names)]
    views = Views(packs, args.seed, round(args.small_share * args.steps))
    plan = Plan(args.steps, args.batch, args.rate, seed=args.seed, bf16=args.bf16, workers=args.workers)
    training = Training(plan, views, args.out, device=args.device, start=args.start)
    print(
        f"{n_parameters(training.network)} parameters, {len(views)} views, from step {training.step} of {plan.steps}",
        flush=True,
    )
    training.run()


if __name__ == "__main__":
    main()
