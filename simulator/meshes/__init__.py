"""Buildings that come as meshes: GLB and OBJ files, HM3D's folders; and any of our buildings written as such."""

from __future__ import annotations

from pathlib import Path

from surveilnav.simulator.meshes.export import export_glb, export_hm3d
from surveilnav.simulator.meshes.layout import is_hm3d
from surveilnav.simulator.world.scene import Scene

__all__ = ["export_glb", "export_hm3d", "is_mesh", "open_scan"]


def is_mesh(path: Path) -> bool:
    """Whether ``open_scan`` is for this path: a .glb or .obj file, or a folder of HM3D."""
    return path.suffix.lower() in (".glb", ".obj", ".gltf") or is_hm3d(path)


def open_scan(path: Path) -> Scene:
    """The building of a GLB, an OBJ or an HM3D folder.

    Raises:
        BuildingError: it isn't there, can't be read or has nowhere to stand.
    """
    # Readers load Open3D and scikit-learn: who opens a plan shouldn't wait for them.
    from surveilnav.simulator.meshes.buildings import open_mesh
    from surveilnav.simulator.meshes.hm3d import open_hm3d

    return open_hm3d(path) if is_hm3d(path) else open_mesh(path)
