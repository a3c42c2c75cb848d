"""The backends by name, and the models that each is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from surveilnav.errors import PerceptionError
from surveilnav.perception import models, parts
from surveilnav.perception.backend import Backend
from surveilnav.perception.chances import chance_table
from surveilnav.perception.detectors import coco
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.names import BackendName
from surveilnav.perception.pipeline import PipelineBackend
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.depth_in_box import DepthInBox
from surveilnav.perception.single_network import SingleNetworkBackend
from surveilnav.perception.sizes import extents_of
from surveilnav.perception.vocabulary import COCO

#: The pairs of networks with the best results for their time on rendered homes: for robots' views, and for cameras'.
DEFAULT_DETECTORS: tuple[str, ...] = ("yolox-nano", "picodet-s")
DEFAULT_LARGE_DETECTORS: tuple[str, ...] = ("yolox-nano", "deimv2-femto")

#: The paper's models: detector, segmenter and embedder.
PAPER: tuple[str, str, str] = ("grounding-dino-tiny", "mobile-sam", "clip-vit-b32")

#: Objects with a lower score aren't reported. With COCO's networks they still count for the view's embedding.
_COCO_MIN_SCORE = 0.25
_YOLO_WORLD_MIN_SCORE = 0.25
#: Batch size on a GPU. A CPU is no faster with batches.
_GPU_BATCH = 8


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """Settings of a backend's models.

    Attributes:
        detectors: names of the networks of ``onnx-coco`` for pictures of up to 900 pixels.
        large_detectors: the same for larger pictures.
        detector, segmenter, embedder: models or folders for ``paper`` and ``yolo-world``; empty: the preset's own.
        words_per_pass: number of words that Grounding DINO looks for at once; 0: as many as fit into its text.
        threshold: the score that a box of ``detector`` needs; None: the one of its paper.
        device, threads, compiled: see ``Runtime``.
        download: whether missing weights may be downloaded.
    """

    detectors: Sequence[str] = DEFAULT_DETECTORS
    large_detectors: Sequence[str] = DEFAULT_LARGE_DETECTORS
    detector: str = ""
    segmenter: str = ""
    embedder: str = ""
    words_per_pass: int = 0
    threshold: float | None = None
    device: str = "auto"
    compiled: bool = False
    threads: int = 1
    download: bool = True


def onnx_coco(networks: NetworkSettings, why: str) -> Backend:
    """``onnx-coco``: several COCO detectors combined, masks from depth, embeddings in the space of COCO's classes.

    Raises:
        PerceptionError: a network can't be found or loaded.
    """
    small, large = tuple(networks.detectors), tuple(networks.large_detectors)
    if not small or not large:
        raise PerceptionError(f"onnx-coco needs at least one detector out of {list(models.COCO_DETECTORS)}")
    files = {n: models.find(n, download=networks.download) for n in dict.fromkeys((*small, *large))}
    runtime = Runtime(networks.device, networks.threads)
    loaded = {n: coco.load(path, models.family(n), runtime) for n, path in files.items()}
    ids = "+".join(models.model_id(n, path) for n, path in files.items())
    description = " + ".join(small) if small == large else f"{' + '.join(small)}; for cameras {' + '.join(large)}"
    kind = "a real detector" if len(loaded) == 1 else "real detectors that have to agree"
    detector = coco.CocoDetector([loaded[n] for n in small], [loaded[n] for n in large], model=ids)
    return PipelineBackend(
        "onnx-coco",
        f"{kind} ({description}), {why}",
        detector,
        DepthInBox(),
        ClassSpace(),
        min_score=_COCO_MIN_SCORE,
        extents_m=extents_of(COCO),
        chances=chance_table("onnx-coco"),
    )


def compact(networks: NetworkSettings, why: str) -> Backend:
    """``compact``: the network that comes with this package, which detects, segments and embeds.

    Raises:
        PerceptionError: its weights aren't part of this installation, or are damaged.
    """
    path = models.find("compact", download=False)
    network = CompactNetwork(open_session(path, Runtime(networks.device, networks.threads)))
    description = f"our own network of {len(network.classes)} classes, trained on rendered homes"
    return SingleNetworkBackend(
        "compact", f"{description}, {why}", network, models.model_id("compact", path), chance_table("compact")
    )


def paper(networks: NetworkSettings, why: str) -> Backend:
    """``paper``: open vocabulary, with Grounding DINO, MobileSAM and CLIP, or the models that the settings name instead.

    Raises:
        PerceptionError: a model can't be found or loaded, or PyTorch isn't installed.
    """
    given = (networks.detector, networks.segmenter, networks.embedder)
    names = [name or default for name, default in zip(given, PAPER, strict=True)]
    runtime = Runtime(networks.device, networks.threads, networks.compiled)
    detector = parts.load_detector(
        names[0],
        runtime,
        words_per_pass=networks.words_per_pass,
        threshold=networks.threshold,
        download=networks.download,
    )
    segmenter = parts.load_segmenter(names[1], runtime, download=networks.download)
    embedder = parts.load_embedder(names[2], runtime, download=networks.download)
    # min_score is 0: the detector itself applies the threshold.
    return PipelineBackend(
        "paper",
        f"any word ({' + '.join(names)}), {why}",
        detector,
        segmenter,
        embedder,
        min_score=0.0,
        best_batch=_GPU_BATCH if parts.runs_on_gpu(runtime) else 1,
    )


def yolo_world(networks: NetworkSettings, why: str) -> Backend:
    """``yolo-world``: YOLO-World from a user's file, with the words that it was exported with; masks from depth, CLIP.

    Raises:
        PerceptionError: the file or CLIP can't be found or loaded.
    """
    name, runtime = networks.detector or "yolo-world", Runtime(networks.device, networks.threads, networks.compiled)
    threshold = _YOLO_WORLD_MIN_SCORE if networks.threshold is None else networks.threshold
    detector = parts.load_detector(name, runtime, threshold=threshold, download=False)
    segmenter = parts.load_segmenter(networks.segmenter or DepthInBox.model, runtime, download=networks.download)
    embedder = parts.load_embedder(networks.embedder or PAPER[2], runtime, download=networks.download)
    description = f"{len(detector.vocabulary or ())} words of its own"
    return PipelineBackend(
        "yolo-world", f"{detector.model} ({description}), {why}", detector, segmenter, embedder, min_score=0.0
    )


#: By name, the function that makes a backend, given the settings and the reason why it was chosen.
PRESETS: Mapping[str, Callable[[NetworkSettings, str], Backend]] = MappingProxyType(
    {
        BackendName.COMPACT: compact,
        BackendName.ONNX_COCO: onnx_coco,
        BackendName.PAPER: paper,
        BackendName.YOLO_WORLD: yolo_world,
    }
)
