"""Small GLBs, written byte by byte or by trimesh."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def glb_bytes(header: dict[str, Any], blob: bytes = b"") -> bytes:
    """A GLB of a header and a binary chunk."""
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    total = 12 + 8 + len(text) + (8 + len(blob) if blob else 0)
    data = struct.pack("<4sIII4s", b"glTF", 2, total, len(text), b"JSON") + text
    return data + (struct.pack("<I4s", len(blob), b"BIN\0") + blob if blob else b"")


#: A hall of 6 x 5 m, 3 m high, as corners in glTF's frame: floor up, ceiling down, four walls inwards.
def hall_corners(width: float = 6.0, depth: float = 5.0, height: float = 3.0) -> np.ndarray:
    """(12, 3, 3) float32 triangles, y up: x to the width, -z to the depth."""
    w, d, h = width, -depth, height
    quads = [
        [(0, 0, 0), (w, 0, 0), (w, 0, d), (0, 0, d)],
        [(0, h, 0), (0, h, d), (w, h, d), (w, h, 0)],
        [(0, 0, 0), (0, h, 0), (w, h, 0), (w, 0, 0)],
        [(0, 0, d), (w, 0, d), (w, h, d), (0, h, d)],
        [(0, 0, 0), (0, 0, d), (0, h, d), (0, h, 0)],
        [(w, 0, 0), (w, h, 0), (w, h, d), (w, 0, d)],
    ]
    return np.array([[q[i] for i in t] for q in quads for t in ((0, 1, 2), (0, 2, 3))], dtype=np.float32)


def hall_header(count: int = 36) -> dict[str, Any]:
    """The header of a GLB whose binary chunk is ``count`` corners; change it at will."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "hall"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 12 * count}],
        "buffers": [{"byteLength": 12 * count}],
    }


@pytest.fixture
def corners() -> np.ndarray:
    return hall_corners()


@pytest.fixture
def hall(tmp_path: Path) -> Callable[..., Path]:
    """``hall(change)`` writes the hall after ``change(header)``; ``corners`` replace its triangles."""

    def write(
        change: Callable[[dict[str, Any]], object] = lambda header: None, corners: np.ndarray | None = None
    ) -> Path:
        corners = hall_corners() if corners is None else corners
        header = hall_header(3 * len(corners))
        change(header)
        path = tmp_path / "hall.glb"
        path.write_bytes(glb_bytes(header, np.asarray(corners, np.float32).tobytes()))
        return path

    return write
