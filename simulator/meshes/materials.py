"""Materials of a GLB: base colours, pictures and painted vertices as the renderer wants them."""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.archive import decode_picture
from surveilnav.simulator.render.tones import to_srgb
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Material

_MANY_PICTURES = 16
TEXTURE_PX, _TEXTURE_PX_OF_MANY = 2048, 1024
#: A palette of vertex colours has so many texels a side.
_PALETTE = 64


def materials_of(header: dict[str, Any], blob: bytes, max_px: int | None) -> tuple[list[Material], tuple[str, ...]]:
    """The materials of a file and, last, the one for surfaces without; and notes on pictures that can't be read."""
    images = header.get("images", [])
    max_px = max_px or (TEXTURE_PX if len(images) <= _MANY_PICTURES else _TEXTURE_PX_OF_MANY)
    pictures: dict[int, NDArray[np.uint8] | None] = {}
    found: list[Material] = []
    unread: set[int] = set()
    for number, stored in enumerate(header.get("materials", [])):
        base = stored.get("pbrMetallicRoughness", {})
        glossy = stored.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        factor = (glossy or {}).get("diffuseFactor") or base.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        used = (glossy or {}).get("diffuseTexture") or base.get("baseColorTexture")
        image = _image_of(header, used)
        if image is not None and image not in pictures:
            decoded = decode_picture(_bytes_of(header, blob, images[image]), max_px)
            pictures[image] = None if decoded is None else decoded[0]
            if decoded is None:
                unread.add(image)
        r, g, b, a = (float(v) for v in (*factor, 1.0, 1.0, 1.0, 1.0)[:4])
        color = to_srgb(np.nan_to_num(np.array([r, g, b])))
        texture = None if image is None else pictures[image]
        found.append(
            Material(
                str(stored.get("name") or f"material {number}"),
                (float(color[0]), float(color[1]), float(color[2])),
                texture,
                a if stored.get("alphaMode") == "BLEND" and math.isfinite(a) else 1.0,
                round(1.0 - float(base.get("roughnessFactor", 1.0)), 6),
            )
        )
    note = f"{len(unread)} of {len(images)} pictures can't be read (PNG and JPEG can): plain colours stand in"
    return [*found, Material("plain", (0.8, 0.8, 0.8))], (note,) if unread else ()


def uv_map_of(stored: dict[str, Any]) -> NDArray[np.float64] | None:
    """KHR_texture_transform of a material as an affine map (2, 3) of (u, v) with v upwards; None without one."""
    used = stored.get("pbrMetallicRoughness", {}).get("baseColorTexture") or {}
    transform = used.get("extensions", {}).get("KHR_texture_transform")
    if not transform:
        return None
    su, sv = (float(v) for v in transform.get("scale", (1.0, 1.0)))
    ou, ov = (float(v) for v in transform.get("offset", (0.0, 0.0)))
    c, s = math.cos(float(transform.get("rotation", 0.0))), math.sin(float(transform.get("rotation", 0.0)))
    # The file's v runs downwards: (u, w) -> offset + R S (u, w), then v = 1 - w on both sides.
    return np.array([[c * su, -s * sv, s * sv + ou], [s * su, c * sv, 1.0 - c * sv - ov]])


def _image_of(header: dict[str, Any], used: dict[str, Any] | None) -> int | None:
    """The number of the picture that a material uses, if any."""
    if used is None:
        return None
    texture = header["textures"][used["index"]]
    source = texture.get("source")
    for name in ("EXT_texture_webp", "KHR_texture_basisu"):
        if source is None:
            source = texture.get("extensions", {}).get(name, {}).get("source")
    return None if source is None else int(source)


def _bytes_of(header: dict[str, Any], blob: bytes, image: dict[str, Any]) -> bytes:
    if "bufferView" in image:
        view = header["bufferViews"][image["bufferView"]]
        start = int(view.get("byteOffset", 0))
        return blob[start : start + int(view["byteLength"])]
    uri = str(image.get("uri", ""))
    _, found, data = uri.partition(";base64,")
    return base64.b64decode(data) if found else b""


def painted(mesh: Mesh, colors: NDArray | None) -> Mesh:
    """The mesh with the colours (F, 3, 3 or 4) of its corners, linear, in a palette; pictures keep their own colours.

    Each triangle gets one colour, the mean of its corners, in 4096 steps at most.
    """
    material = mesh.materials[0]
    if colors is None or material.texture is not None or colors.shape[:2] != mesh.triangles.shape or not len(colors):
        return mesh
    scale = {"u1": 255.0, "u2": 65535.0}.get(colors.dtype.str[1:], 1.0)
    linear = np.nan_to_num(colors[..., :3].astype(np.float64).mean(axis=1) / scale)
    rgb = np.round(to_srgb(linear) * 255).astype(np.int64)
    for step in (1, 2, 4, 8, 16):  # coarser until the palette holds them
        keys = np.unique((rgb // step) @ np.array([1 << 16, 1 << 8, 1]), return_inverse=True)
        if len(keys[0]) <= _PALETTE**2:
            break
    index = np.asarray(keys[1]).reshape(-1)
    count = len(keys[0])
    weight = np.maximum(np.bincount(index, minlength=count), 1)[:, None]
    mean = np.stack([np.bincount(index, rgb[:, c].astype(float), count) for c in range(3)], axis=1) / weight
    size = math.ceil(math.sqrt(count))
    texture = np.zeros((size * size, 3), np.uint8)
    texture[:count] = np.round(mean)
    row, col = np.divmod(index, size)
    middle = np.stack([(col + 0.5) / size, 1.0 - (row + 0.5) / size], axis=1).astype(np.float32)
    # One texel per colour: the renderer's coarser picture levels would mix neighbours, so each texel becomes a block.
    picture = np.repeat(np.repeat(texture.reshape(size, size, 3), 8, axis=0), 8, axis=1)
    return replace(mesh, uvs=np.repeat(middle[:, None], 3, axis=1), materials=(replace(material, texture=picture),))
