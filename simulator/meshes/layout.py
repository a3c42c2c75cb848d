"""Which paths are HM3D's."""

from __future__ import annotations

import re
from pathlib import Path


def is_hm3d(path: Path) -> bool:
    """Whether a folder is a scene of HM3D, or a file belongs to one."""
    if path.is_dir():
        return stem_of(path) is not None
    return path.suffix.lower() == ".glb" and path.is_file() and stem_of(path.parent) is not None


def stem_of(folder: Path) -> str | None:
    """XXXX, if the folder has an XXXX.semantic.txt or is named 00800-XXXX."""
    texts = sorted(p.name.removesuffix(".semantic.txt") for p in folder.glob("*.semantic.txt"))
    if texts:
        return texts[0]
    match = re.fullmatch(r"\d{5}-(.+)", folder.name)
    return match[1] if match else None
