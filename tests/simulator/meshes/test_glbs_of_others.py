"""GLBs that other people's programs wrote: all below the folder that ``SURVEILNAV_GLB_DIR`` names.

Any will do. Packages that carry some: npm's ``@webxr-input-profiles/assets`` (82), PyPI's ``gradio`` (1).
"""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import pytest

from surveilnav.simulator.meshes.gltf import read_glb

pytest.importorskip("trimesh")

_FOLDER = os.environ.get("SURVEILNAV_GLB_DIR", "")
_FILES = sorted(Path(_FOLDER).rglob("*.glb")) if _FOLDER else []
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@pytest.mark.skipif(not _FILES, reason="SURVEILNAV_GLB_DIR names no folder with GLBs")
@pytest.mark.parametrize("path", _FILES, ids=lambda p: str(p.relative_to(_FOLDER)))
def test_every_triangle_that_the_header_promises_is_read(path: Path) -> None:
    glb = read_glb(path)
    assert not [note for note in glb.notes if "triangles" in note]
    assert sum(len(node.mesh.triangles) for node in glb.meshes) == _promised(_header(path)) > 0


def _header(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    header: dict[str, Any] = json.loads(data[20 : 20 + length])
    return header


def _promised(header: dict[str, Any]) -> int:
    """Triangles of the shown scene by the counts of its accessors: a mesh counts once for every node that has it."""
    total, waiting = 0, list(header["scenes"][header.get("scene", 0)]["nodes"])
    while waiting:
        node = header["nodes"][waiting.pop()]
        waiting += node.get("children", [])
        for primitive in header["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            corners = header["accessors"][primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
            total += {_TRIANGLES: corners // 3, _STRIP: corners - 2, _FAN: corners - 2}.get(primitive.get("mode", 4), 0)
    return total
