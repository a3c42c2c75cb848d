"""Trains the depth network on packed views. Started again after an interruption, it goes on where it was.

    python -m training.depth.train --views data/depth/train --out runs/depth --steps 3000

``--out`` gets ``checkpoint.pt``, written every three minutes, and ``curve.csv``, the parts of the loss by step.
"""

from __future__ import annotations

import argparse
import copy
import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor, distributed, multiprocessing, nn

from surveilnav.storage import atomic_write
from training.depth.data import Batch, Views
from training.depth.network import DepthNet, Predictions, Shape
from training.depth.pack import read_packs
from training.learning import blend, cosine_rate, n_parameters, weight_groups

_CHECKPOINT_S, _LOG_EVERY = 180.0, 20
#: A floor pixel counts this much in the regression, since where the floor is, the depth is known.
_FLOOR_WEIGHT = 0.5
#: The likelihood is weighted by this power of the uncertainty; otherwise certain pixels learn and others don't.
_BETA = 0.5
WEIGHTS = {"likelihood": 1.0, "floor": 1.0, "edges": 0.5}


@dataclass(frozen=True, slots=True)
class Plan:
    """How it is trained. ``steps``: in all; ``batch``: views in a step; ``rate``: highest learning rate, reached after
    ``warm_up`` steps, after which a half cosine takes it to ``last`` of that; ``decay``: of weights."""

    steps: int
    batch: int = 12
    rate: float = 2e-3
    last: float = 0.02
    warm_up: int = 100
    decay: float = 0.02
    seed: int = 0

    def rate_at(self, step: int) -> float:
        return cosine_rate(step, steps=self.steps, rate=self.rate, warm_up=self.warm_up, last=self.last)


def losses(predicted: Predictions, batch: Batch) -> dict[str, Tensor]:
    """The parts of the loss, each a mean over cells with a depth.

    likelihood: negative logarithm of the Laplace density of the log-ratio, times sigma ** ``_BETA`` (Seitzer et al. 2022).
    floor: cross-entropy. edges: absolute error of the log-ratio's differences between neighbours.
    """
    known = batch.known.float()
    weight = known * torch.where(batch.floor, _FLOOR_WEIGHT, 1.0)
    error = (predicted.log_ratio - batch.log_ratio).abs()
    density = error * torch.exp(-predicted.log_sigma) + predicted.log_sigma
    likelihood = density * torch.exp(_BETA * predicted.log_sigma.detach())
    floor = nn.functional.binary_cross_entropy_with_logits(predicted.floor, batch.floor.float(), reduction="none")
    edges = torch.zeros(())
    for dim in (1, 2):
        both = known.narrow(dim, 1, known.shape[dim] - 1) * known.narrow(dim, 0, known.shape[dim] - 1)
        off = (predicted.log_ratio.diff(dim=dim) - batch.log_ratio.diff(dim=dim)).abs()
        edges = edges + (off * both).sum() / both.sum().clamp(min=1.0)
    return {
        "likelihood": (likelihood * weight).sum() / weight.sum().clamp(min=1.0),
        "floor": (floor * known).sum() / known.sum().clamp(min=1.0),
        "edges": edges,
    }


class Training:
    """A run in progress. ``network`` learns; ``mean`` is the running mean of its weights, which is exported."""

    def __init__(self, plan: Plan, views: Views, out: Path, shape: Shape | None = None) -> None:
        torch.manual_seed(plan.seed)
        self.plan, self.views, self.out, self.step, self.views_seen = plan, views, out, 0, 0
        self.shape = shape or Shape()
        self.network = DepthNet(self.shape).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.mean = copy.deepcopy(self.network).eval().requires_grad_(False)
        self.optimiser = torch.optim.AdamW(weight_groups(self.network, plan.decay), lr=plan.rate)
        if self.checkpoint.exists():
            kept = torch.load(self.checkpoint, weights_only=True)
            self.step, self.views_seen = kept["step"], kept["views_seen"]
            self.network.load_state_dict(kept["network"])
            self.mean.load_state_dict(kept["mean"])
            self.optimiser.load_state_dict(kept["optimiser"])

    @property
    def checkpoint(self) -> Path:
        return self.out / "checkpoint.pt"

    def save(self) -> None:
        """Writes the checkpoint atomically."""
        if _process() > 0:
            return
        kept = {
            "step": self.step,
            "views_seen": self.views_seen,
            "shape": asdict(self.shape),
            "network": self.network.state_dict(),
            "mean": self.mean.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        with atomic_write(self.checkpoint) as file:
            torch.save(kept, file)

    def run(self, minutes: float = math.inf) -> None:
        """Trains to the end of the plan, or for so many minutes."""
        begun, first, saved = time.perf_counter(), self.step, time.perf_counter()
        sums: dict[str, float] = {}
        for batch in self.views.batches(self.step, self.plan.steps, self.plan.batch):
            for name, value in self.one_step(batch).items():
                sums[name] = sums.get(name, 0.0) + value
            if self.step % _LOG_EVERY == 0:
                n = min(_LOG_EVERY, self.step - first)
                left_min = (time.perf_counter() - begun) / (self.step - first) * (self.plan.steps - self.step) / 60
                self._log({name: value / n for name, value in sums.items()}, left_min)
                sums = {}
            if _mean_of_processes(torch.tensor(time.perf_counter() - begun)) > 60 * minutes:
                break
            if time.perf_counter() - saved > _CHECKPOINT_S:
                self.save()
                saved = time.perf_counter()
        self.save()

    def one_step(self, batch: Batch) -> dict[str, float]:
        """One step of learning; the parts of the loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate_at(self.step)
        self.network.train()
        pictures = (batch.pictures.float() / 255.0).contiguous(memory_format=torch.channels_last)
        predicted = self.network(pictures, batch.geometry.contiguous(memory_format=torch.channels_last))
        parts = losses(predicted, batch)
        self.optimiser.zero_grad(set_to_none=True)
        torch.stack([WEIGHTS[name] * part for name, part in parts.items()]).sum().backward()  # type: ignore[no-untyped-call]
        if distributed.is_initialized():  # in one piece, which takes one round of messages
            gradients = [p.grad for p in self.network.parameters() if p.grad is not None]
            mean = _mean_of_processes(torch.cat([g.flatten() for g in gradients]))
            for gradient, part in zip(gradients, mean.split([g.numel() for g in gradients]), strict=True):
                gradient.copy_(part.view_as(gradient))
        nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        blend(self.mean, self.network, min(0.99, (1.0 + self.step) / (10.0 + self.step)))
        self.step += 1
        self.views_seen += self.plan.batch * (distributed.get_world_size() if distributed.is_initialized() else 1)
        return {name: float(part.detach()) for name, part in parts.items()}

    def _log(self, parts: dict[str, float], left_min: float) -> None:
        if _process() > 0:
            return
        values = ", ".join(f"{name} {value:.3f}" for name, value in parts.items())
        print(f"step {self.step} of {self.plan.steps}: {values}; {left_min:.0f} min left", flush=True)
        path = self.out / "curve.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        begins = not path.exists()
        with path.open("a", encoding="utf-8") as file:
            if begins:
                file.write(",".join(["step", *parts]) + "\n")
            file.write(",".join([str(self.step), *(f"{value:.4f}" for value in parts.values())]) + "\n")


def _process() -> int:
    """Number of this process among those that train together."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def _mean_of_processes(x: Tensor) -> Tensor:
    """The mean of a tensor over the processes that train together."""
    if distributed.is_initialized():
        x = x.contiguous()
        distributed.all_reduce(x)
        x /= distributed.get_world_size()
    return x


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.depth.train", description=__doc__.partition("\n")[0])
    parser.add_argument("--views", type=Path, nargs="+", required=True, help="folders of packs")
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--batch", type=int, default=12)
    parser.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
    parser.add_argument("--small-share", type=float, default=0.6, help="of the steps, with small pictures")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2, help="of each process")
    parser.add_argument(
        "--processes", type=int, default=1, help="that average their gradients, each on a batch of its own"
    )
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop earlier; started again, it goes on")
    args = parser.parse_args(argv)
    if args.processes == 1:
        _train(0, args)
        return
    with tempfile.TemporaryDirectory() as folder:
        args.meeting = Path(folder) / "meeting"
        multiprocessing.spawn(_train, (args,), args.processes)


def _train(process: int, args: argparse.Namespace) -> None:
    """One process of the training."""
    if args.processes > 1:
        distributed.init_process_group("gloo", f"file://{args.meeting}", rank=process, world_size=args.processes)
    torch.set_num_threads(args.threads)
    packs = [pack for folder in args.views for pack in read_packs(folder)]
    views = Views(packs, args.seed, round(args.small_share * args.steps), process)
    training = Training(Plan(args.steps, args.batch, args.rate, seed=args.seed), views, args.out)
    print(f"{n_parameters(training.network)} parameters, {len(views)} views, from step {training.step}", flush=True)
    training.run(args.minutes)
    if distributed.is_initialized():
        distributed.destroy_process_group()


if __name__ == "__main__":
    main()
