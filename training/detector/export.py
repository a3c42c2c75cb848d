"""Writes ``compact`` as an ONNX file from a checkpoint.

    python -m training.detector.export --checkpoint runs/compact/checkpoint.pt --out runs/compact/compact.onnx

Inputs: ``picture`` (1, H, W, 3) uint8 RGB; H and W are multiples of 32. ``depth`` (1, H / 2, W / 2, 7) float32 as
``depth_channels`` has it. Outputs, L places: ``scores`` (L, C), ``ltrb`` (L, 4)
[pixels], ``coefficients`` (L, K), ``embeddings`` (L, D), ``prototypes`` (K, H / 4, W / 4), ``image`` (D,), ``near`` (C + R,)
chances. The file's metadata are JSON: ``classes``, ``rooms``, ``meanings`` (by another word, the class that it means),
``class_vectors`` (C, D), ``near_vectors`` (C + R, D). ``card.json`` beside it says what is known of the weights.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor, nn

from surveilnav.perception.detectors.depth_channels import N_CHANNELS
from surveilnav.perception.models.card import Card, save_card
from surveilnav.storage import atomic_write
from training.detector import classes
from training.detector.network import Compact, Shape
from training.detector.train import steps_of
from training.learning import n_parameters

OUTPUTS = ("scores", "ltrb", "coefficients", "embeddings", "prototypes", "image", "near")
_OPSET = 17


class _OnePicture(nn.Module):
    """The network on one picture of bytes, with chances for logits."""

    def __init__(self, network: Compact) -> None:
        super().__init__()
        self.network = network

    def forward(self, picture: Tensor, depth: Tensor) -> tuple[Tensor, ...]:
        predicted = self.network(picture.permute(0, 3, 1, 2).float() / 255.0, depth.permute(0, 3, 1, 2))
        return (
            predicted.logits[0].sigmoid(),
            predicted.ltrb[0],
            predicted.coefficients[0],
            predicted.embeddings[0],
            predicted.prototypes[0],
            predicted.image[0],
            predicted.near[0].sigmoid(),
        )


def export(network: Compact, path: Path) -> int:
    """Writes the file; returns its size in bytes."""
    wrapped, buffer = _OnePicture(network).eval(), io.BytesIO()
    example = torch.zeros((1, 256, 320, 3), dtype=torch.uint8), torch.zeros((1, 128, 160, N_CHANNELS))
    sides, half = {1: "height", 2: "width"}, {1: "half_height", 2: "half_width"}
    torch.onnx.export(
        wrapped,
        example,
        buffer,
        input_names=["picture", "depth"],
        output_names=list(OUTPUTS),
        opset_version=_OPSET,
        dynamo=False,
        dynamic_axes={"picture": sides, "depth": half, "prototypes": {1: "rows", 2: "columns"}}
        | {name: {0: "places"} for name in OUTPUTS[:4]},
    )
    model = onnx.load_model_from_string(buffer.getvalue())
    names = classes.load()
    for key, value in {
        "classes": list(names.names),
        "rooms": list(names.rooms),
        "meanings": names.meanings,
        "class_vectors": _rounded(network.classes.vectors),
        "near_vectors": _rounded(network.surroundings.vectors),
    }.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, json.dumps(value)
    with atomic_write(path) as file:
        file.write(model.SerializeToString())
    return path.stat().st_size


def _rounded(vectors: Tensor) -> list[list[float]]:
    """Unit rows."""
    return [[round(float(v), 5) for v in row] for row in nn.functional.normalize(vectors.detach(), dim=1)]


def write_card(path: Path, network: Compact, steps: int, views_seen: int) -> Card:
    """Writes what is known of the weights in a file beside it; what they find, ``evaluate`` adds."""
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    card = Card(sha256, path.stat().st_size, n_parameters(network), steps, views_seen)
    save_card(path, card)
    return card


def write_weights(path: Path, kept: dict[str, Any]) -> None:
    """Writes the mean weights of a checkpoint, in half precision, without what only the same run could go on with."""
    halved = {name: x.half() if x.dtype.is_floating_point else x for name, x in kept["mean"].items()}
    with atomic_write(path) as file:
        torch.save({"step": steps_of(kept), "shape": kept["shape"], "mean": halved}, file)


def _network_of(kept: dict[str, Any]) -> Compact:
    names = classes.load()
    network = Compact(len(names.names), len(names.rooms), Shape(**kept["shape"]))
    network.load_state_dict(kept["mean"])
    network.eval()
    return network


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="training.detector.export", description=__doc__.partition("\n")[0])
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--batch", type=int, default=16, help="views a step of the training")
    parser.add_argument("--weights", type=Path, help="also write what another run can begin with (train --start)")
    args = parser.parse_args(argv)
    kept = torch.load(args.checkpoint, map_location="cpu", weights_only=True)
    network = _network_of(kept)
    export(network, args.out)
    card = write_card(args.out, network, steps_of(kept), steps_of(kept) * args.batch)
    if args.weights:
        write_weights(args.weights, kept)
    print(f"{args.out}: {card.bytes / 1e6:.2f} MB, {card.parameters} parameters, sha256 {card.sha256}")


if __name__ == "__main__":
    main()
