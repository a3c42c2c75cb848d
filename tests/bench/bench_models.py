"""Full-size networks on random weights: time by batch and by words, and memory. Weights that were trained cost the same.

    make bench-models [ARGS="--device cuda --batches 1 4 8"]     # a table; hours are not needed: minutes on a processor

Runs in .venv-torch. Nothing is downloaded: the models are made from their config classes, saved to a folder and loaded by
the path on which published ones run.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil
from transformers.models.grounding_dino.image_processing_pil_grounding_dino import GroundingDinoImageProcessorPil

from surveilnav.perception import parts
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.runtime import Runtime
from tests.torch import tiny

WORDS = tuple(
    f"{colour} {thing}"
    for colour in ("red", "old")
    for thing in ("couch", "wardrobe", "bed", "tv", "pot", "chair", "lamp", "book")
)
PICTURE = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)


def grounding_dino(folder: Path) -> Path:
    """Grounding DINO with a Swin-T, as ``grounding-dino-tiny``."""
    swin = transformers.SwinConfig(
        embed_dim=96,
        depths=[2, 2, 6, 2],
        num_heads=[3, 6, 12, 24],
        window_size=7,
        image_size=224,
        out_features=["stage2", "stage3", "stage4"],
    )
    model = transformers.GroundingDinoForObjectDetection(transformers.GroundingDinoConfig(backbone_config=swin))
    tokenizer = tiny.bert_tokenizer(sorted({part for word in WORDS for part in word.split()}))
    return tiny.saved(model, folder, tokenizer, GroundingDinoImageProcessorPil())


def clip(folder: Path) -> Path:
    """CLIP with a ViT-B/32, as ``clip-vit-b32``."""
    tokenizer = tiny.clip_tokenizer()
    text = {"bos_token_id": len(tokenizer) - 2, "eos_token_id": len(tokenizer) - 1}
    model = transformers.CLIPModel(transformers.CLIPConfig(text_config=text))
    return tiny.saved(model, folder, tokenizer, CLIPImageProcessorPil())


def sam2(folder: Path) -> Path:
    """SAM 2.1 with a Hiera-T, as ``sam2.1-tiny``."""
    return tiny.saved(transformers.Sam2Model(transformers.Sam2Config()), folder)


def timed(run: Callable[[], object], repeats: int, device: str) -> float:
    """Median seconds of a run, after one that doesn't count."""
    took = []
    for _ in range(repeats + 1):
        began_s = time.perf_counter()
        run()
        if device != "cpu":
            torch.cuda.synchronize()
        took.append(time.perf_counter() - began_s)
    return float(np.median(took[1:]))


def memory_mb(device: str) -> float:
    """The most memory so far: of the GPU, else of the process."""
    if device != "cpu":
        return torch.cuda.max_memory_allocated() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def detector_rows(folder: Path, runtime: Runtime, batches: Sequence[int], repeats: int) -> list[str]:
    rows = []
    for n_words, per_pass in ((1, 0), (4, 0), (4, 1), (16, 0), (16, 4)):
        detector = parts.load_detector(str(folder), runtime, words_per_pass=per_pass)
        for batch in batches:
            asked = [WORDS[:n_words]] * batch
            seconds = timed(lambda d=detector, b=batch, a=asked: d.detect([PICTURE] * b, a), repeats, runtime.device)
            passes = n_words // per_pass if per_pass else 1
            what = f"Grounding DINO, Swin-T, {n_words} words in {passes} passes"
            rows.append(f"| {what} | {batch} | {seconds / batch:.2f} | {memory_mb(runtime.device):,.0f} |")
    return rows


def other_rows(clip_at: Path, sam_at: Path, runtime: Runtime, batches: Sequence[int], repeats: int) -> list[str]:
    rows, box = [], np.array([[100, 100, 300, 300]], np.float32)
    embedder: Any = parts.load_embedder(str(clip_at), runtime)
    segmenter: Any = parts.load_segmenter(str(sam_at), runtime)
    from surveilnav.geometry import Pinhole
    from surveilnav.perception.protocols import RgbdView

    view = RgbdView(PICTURE, np.ones(PICTURE.shape[:2], np.float32), Pinhole.from_hfov(640, 480, 1.4))
    for batch in batches:
        boxes = [Boxes(box, np.ones((1, 1), np.float32), ("couch",))] * batch
        jobs = {
            "CLIP, ViT-B/32, a view and a box": lambda b=batch, x=boxes: embedder.embed_views(
                [PICTURE] * b, x, [np.array([0])] * b
            ),
            "SAM 2.1, Hiera-T, one box": lambda b=batch: segmenter.segment([view] * b, [box] * b),
        }
        for what, job in jobs.items():
            seconds = timed(job, repeats, runtime.device)
            rows.append(f"| {what} | {batch} | {seconds / batch:.2f} | {memory_mb(runtime.device):,.0f} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests/bench/bench_models.py", description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--batches", type=int, nargs="+", default=[1])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--compiled", action="store_true", help="torch.compile, on a GPU")
    args = parser.parse_args()
    runtime = Runtime(args.device, args.threads, args.compiled)
    print("| network | views a batch | s a view | most memory so far, MB |", "|---|---|---|---|", sep="\n")
    with tempfile.TemporaryDirectory() as at:
        torch.manual_seed(0)
        for row in other_rows(clip(Path(at) / "clip"), sam2(Path(at) / "sam2"), runtime, args.batches, args.repeats):
            print(row, flush=True)
        for row in detector_rows(grounding_dino(Path(at) / "grounding-dino"), runtime, args.batches, args.repeats):
            print(row, flush=True)


if __name__ == "__main__":
    main()
