"""Rendered camera views on disk: a camera that has all its views cached needs no building in memory.

An entry holds the *clean* picture of one pose: JPEG colours, depth in steps of 0.5 mm, instance ids. Depth range and
noise are applied on reading (they are cheap, and deterministic in their seed), so views that differ only there share an
entry. What is damaged is made again.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import zstandard
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.sensing.depth_codec import from_byte_planes, to_byte_planes
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.picture import PICTURES_VERSION, Lighting, Rendered, within
from surveilnav.storage import FolderCache

if TYPE_CHECKING:
    from surveilnav.simulator.render.renderer import Renderer

_FORMAT = b"surveilnav view 1"
_DEPTH_STEP_M = 0.0005
_JPEG_QUALITY = 95


class ViewCache:
    """Views in a folder, at most ``max_bytes`` in all. Counts its ``hits`` and ``misses``."""

    def __init__(self, cache_dir: Path, max_bytes: int = 2_000_000_000) -> None:
        self._files = FolderCache(Path(cache_dir) / "views", _FORMAT, ".view", max_bytes)
        self.hits = 0
        self.misses = 0

    def get_or_render(
        self,
        renderer_factory: Callable[[], Renderer],
        scene_hash: str,
        T_world_camera: Matrix4,
        camera: Pinhole,
        *,
        lighting: Lighting = "baked",
        depth_range_m: tuple[float, float] = (0.0, 20.0),
        noise: DepthNoise | None = None,
        seed: int = 0,
    ) -> Rendered:
        """The view from the cache, else rendered by ``renderer_factory()`` (called only then) and kept.

        The same bytes come back whether it was cached or not: a new view is decoded from its own entry too.

        Raises:
            ValueError: the renderer shows another scene, or uses another light, than the key says.
        """
        key = self.key_of(scene_hash, T_world_camera, camera, lighting)
        damaged = ValueError, zstandard.ZstdError, cv2.error
        clean = self._files.read(key, lambda parts: _decode(parts, camera), *damaged)
        if clean is None:
            self.misses += 1
            renderer = renderer_factory()
            if (renderer.scene.content_hash, renderer.lighting) != (scene_hash, lighting):
                raise ValueError(
                    f"the view's key says scene {scene_hash!r} with {lighting} light, the renderer shows "
                    f"{renderer.scene.content_hash!r} with {renderer.lighting} light"
                )
            parts = _encode(renderer.render(T_world_camera, camera, depth_range_m=(0.0, 65535 * _DEPTH_STEP_M)))
            self._files.put(key, parts)
            clean = _decode(parts, camera)
        else:
            self.hits += 1
        depth_m = clean.depth_m if noise is None else noise.apply(clean.depth_m, camera, seed)
        return Rendered(clean.rgb, within(depth_m, depth_range_m), clean.instance_ids)

    def key_of(self, scene_hash: str, T_world_camera: Matrix4, camera: Pinhole, lighting: Lighting) -> str:
        """A view's name: a hash of everything that the clean picture depends on."""
        digest = hashlib.sha256()
        digest.update(f"{_FORMAT!r} {PICTURES_VERSION} {scene_hash} {lighting}".encode())
        digest.update(np.ascontiguousarray(T_world_camera, dtype="<f8").round(9).tobytes())
        lens = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        digest.update(struct.pack("<2i4d", camera.width_px, camera.height_px, *lens))
        return digest.hexdigest()


def _encode(rendered: Rendered) -> list[bytes]:
    ok, jpeg = cv2.imencode(".jpg", rendered.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not ok:
        raise ValueError("the picture can't be encoded as JPEG")
    steps = np.round(rendered.depth_m / np.float32(_DEPTH_STEP_M)).astype(np.uint16)
    # Differences between rows, high and low bytes apart: smooth surfaces become runs that zstd likes.
    rows = np.diff(steps, axis=0, prepend=np.zeros((1, steps.shape[1]), np.uint16)).astype("<u2")
    ids = rendered.instance_ids.astype("<u2")
    pack = zstandard.ZstdCompressor(level=3).compress
    return [jpeg.tobytes(), pack(to_byte_planes(rows)), pack(to_byte_planes(ids))]


def _decode(parts: Sequence[bytes], camera: Pinhole) -> Rendered:
    jpeg, depth, ids = parts
    shape = (camera.height_px, camera.width_px)
    bgr = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
    if bgr is None or bgr.shape[:2] != shape:
        raise ValueError(f"the entry's picture isn't {shape}")
    steps = _from_planes(depth, shape)
    for above, row in pairwise(steps):
        row += above  # in place, row by row: a third of the time of np.cumsum
    depth_m = steps.astype(np.float32) * np.float32(_DEPTH_STEP_M)
    return Rendered(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), depth_m, _from_planes(ids, shape))


def _from_planes(packed: bytes, shape: tuple[int, int]) -> NDArray[np.uint16]:
    size = 2 * shape[0] * shape[1]
    raw = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if len(raw) != size:
        raise ValueError(f"an entry of {shape} pixels holds {size} bytes, got {len(raw)}")
    return from_byte_planes(raw, shape)
