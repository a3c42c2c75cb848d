"""OBJ files of whole buildings: our own reader, with the MTL file and pictures that lie beside it."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from surveilnav.errors import BuildingError
from surveilnav.simulator.archive import MAX_MEMBER_BYTES
from surveilnav.simulator.furniture.models import load_model
from surveilnav.simulator.meshes.materials import TEXTURE_PX
from surveilnav.simulator.world.assembly import Mesh

MAX_BYTES = 2 << 30


def read_obj_building(path: Path) -> list[tuple[str, Mesh]]:
    """Name and mesh (in the file's frame) of every group.

    Raises:
        BuildingError: not an OBJ, or larger than the limits.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BuildingError(f"{path} is {size >> 20} MiB, more than {MAX_BYTES >> 20}: simplify it or split it")
    folder = path.parent.resolve()

    def read(name: str) -> bytes | None:
        """A file beside the OBJ, never one outside of its folder."""
        target = (folder / PurePosixPath(name)).resolve()
        if not target.is_relative_to(folder) or not target.is_file():
            return None
        if target != path.resolve() and target.stat().st_size > MAX_MEMBER_BYTES:
            return None
        return target.read_bytes()

    model = load_model(path.name, read, max_texture_px=TEXTURE_PX)
    found = []
    for number, name in enumerate(model.group_names):
        chosen = model.group == number
        if chosen.any():
            mesh = model.part(chosen)
            found.append((name or "building", mesh))
    return found
