"""Writes the depth network as an ONNX file from a checkpoint, with its uncertainty scaled to fit held-out views.

    python -m training.depth.export --checkpoint runs/depth/checkpoint.pt --views data/depth/val --out runs/depth/depth.onnx

Inputs: ``picture`` (1, H, W, 3) uint8 RGB, H and W multiples of 32; ``geometry`` (1, H / 2, W / 2, 5) float32 as
``reference_channels`` has it. Outputs (H / 2, W / 2): ``log_ratio``; ``sigma_log``, which 68 in 100 errors are below;
``floor``, chances. ``card.json`` beside the file says what is known of the weights; ``evaluate`` adds what they find.
"""

from __future__ import annotations

import argparse
import hashlib
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from surveilnav.perception.depth.network import FORMAT, FORMAT_KEY, INPUTS, OUTPUTS
from surveilnav.perception.depth.reference import N_CHANNELS
from surveilnav.storage import atomic_write
from training.depth.card import Card, save_card
from training.depth.evaluate import samples_of
from training.depth.network import DepthNet, Shape
from training.depth.pack import read_packs
from training.learning import n_parameters

_OPSET = 17
_ONE_SIGMA = 0.6827


class _OnePicture(nn.Module):
    """The network on one picture of bytes. ``factor``: of the uncertainty."""

    def __init__(self, network: DepthNet, factor: float) -> None:
        super().__init__()
        self.network, self.factor = network, factor

    def forward(self, picture: Tensor, geometry: Tensor) -> tuple[Tensor, ...]:
        predicted = self.network(picture.permute(0, 3, 1, 2).float() / 255.0, geometry.permute(0, 3, 1, 2))
        return predicted.log_ratio[0], predicted.log_sigma[0].exp() * self.factor, predicted.floor[0].sigmoid()


def export(network: DepthNet, path: Path, factor: float = 1.0) -> int:
    """Writes the file; returns its size in bytes. ``factor``: that the network's uncertainty is multiplied by."""
    wrapped, buffer = _OnePicture(network, factor).eval(), io.BytesIO()
    torch.onnx.export(
        wrapped,
        (torch.zeros((1, 192, 256, 3), dtype=torch.uint8), torch.zeros((1, 96, 128, N_CHANNELS))),
        buffer,
        input_names=list(INPUTS),
        output_names=list(OUTPUTS),
        opset_version=_OPSET,
        dynamo=False,
        dynamic_axes={INPUTS[0]: {1: "height", 2: "width"}, INPUTS[1]: {1: "rows", 2: "columns"}}
        | {name: {0: "rows", 1: "columns"} for name in OUTPUTS},
    )
    model = onnx.load_model_from_string(buffer.getvalue())
    entry = model.metadata_props.add()
    entry.key, entry.value = FORMAT_KEY, FORMAT
    with atomic_write(path) as file:
        file.write(model.SerializeToString())
    return path.stat().st_size


def fitted_factor(path: Path, views: Path) -> float:
    """What the uncertainty of a file must be multiplied by so that 68 in 100 errors are smaller.

    It is fitted on every second building of a folder of views, without the pixels that were taken for floor.
    """
    samples = samples_of(path, read_packs(views)[::2])
    kept = samples.known & ~samples.taken_for_floor
    return float(np.quantile(samples.error[kept] / samples.sigma_log[kept], _ONE_SIGMA))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.depth.export", description=__doc__.partition("\n")[0])
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--views", type=Path, required=True, help="a folder of views that training doesn't see")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args(argv)
    kept = torch.load(args.checkpoint, map_location="cpu", weights_only=True)
    network = DepthNet(Shape(**kept["shape"]))
    network.load_state_dict(kept["mean"])
    network.eval()
    export(network, args.out)
    factor = fitted_factor(args.out, args.views)
    size = export(network, args.out, factor)
    sha256 = hashlib.sha256(args.out.read_bytes()).hexdigest()
    save_card(args.out, Card(sha256, size, n_parameters(network), kept["step"], kept["views_seen"], factor))
    print(f"{args.out}: {size / 1e6:.2f} MB, {n_parameters(network)} parameters, sigma times {factor:.2f}")


if __name__ == "__main__":
    main()
