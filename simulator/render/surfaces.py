"""What shading needs of a scene: its opaque triangles, and all textures in one array."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.render.tones import LINEAR_OF_BYTE, to_linear
from surveilnav.simulator.world.scene import Material, Scene


class Surfaces(NamedTuple):
    """What shading needs of the opaque triangles, in the ray caster's order (T of them).

    Attributes:
        corners: (T, 3, 3) float32 [m, world].
        normals: (T, 3) float32 unit, by the right hand rule; zero for degenerate triangles.
        uvs: (T, 3, 2) float32, finite.
        materials: (T,) int32 into ``colors`` and ``texture``.
        instances: (T,) uint16.
        texels_per_m: (T,) float32, texture texels along a metre of surface (0: untextured).
        colors: (M, 3) float32 linear.
        texture: (M, 2) int32, first row in ``mips`` and number of levels (0: untextured).
        mips: (levels, 3) int64: offset into ``texels``, width, height.
        texels: (N, 3) uint8 sRGB, all levels of all textures after each other.
        mean_colors: (M, 3) float32 linear, colour times the texture's mean: for bounced light.
    """

    corners: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    materials: NDArray[np.int32]
    instances: NDArray[np.uint16]
    texels_per_m: NDArray[np.float32]
    colors: NDArray[np.float32]
    texture: NDArray[np.int32]
    mips: NDArray[np.int64]
    texels: NDArray[np.uint8]
    mean_colors: NDArray[np.float32]


def surfaces_of(scene: Scene, triangle_index: NDArray[np.integer]) -> Surfaces:
    """Gathers what shading needs of the triangles ``triangle_index`` (T,) of a scene; tolerates sloppy data."""
    corners = np.ascontiguousarray(scene.vertices[scene.triangles[triangle_index]], dtype=np.float32).reshape(-1, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float32)
    twice_area = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(twice_area, 1e-20)[:, None]
    uvs = np.nan_to_num(scene.uvs[triangle_index], nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32).reshape(-1, 3, 2)
    uvs -= np.floor(uvs.min(axis=1, keepdims=True))  # textures wrap; far coordinates would cost precision
    materials = scene.material_of_triangle[triangle_index].astype(np.int32)
    colors, texture, mips, texels, mean_colors = _pack_textures(scene.materials)

    edge1, edge2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    uv_area = np.abs(edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0])
    sizes = np.zeros(len(texture), dtype=np.float32)
    textured = texture[:, 1] > 0
    sizes[textured] = mips[texture[textured, 0], 1] * mips[texture[textured, 0], 2]
    texels_per_m = np.sqrt(uv_area * sizes[materials] / np.maximum(twice_area, 1e-12)).astype(np.float32)
    instances = np.ascontiguousarray(scene.instance_of_triangle[triangle_index], dtype=np.uint16)
    return Surfaces(
        corners, normals, uvs, materials, instances, texels_per_m, colors, texture, mips, texels, mean_colors
    )


def _pack_textures(materials: tuple[Material, ...]) -> tuple[Any, ...]:
    """All textures with their mip levels in one array; pictures shared by materials are packed once."""
    colors = to_linear(np.array([m.color for m in materials], dtype=np.float64).reshape(-1, 3)).astype(np.float32)
    mean_colors = colors.copy()
    texture = np.zeros((len(materials), 2), dtype=np.int32)
    mips: list[tuple[int, int, int]] = []
    texels: list[NDArray[np.uint8]] = []
    packed: dict[int, tuple[int, int]] = {}
    offset = 0
    for index, material in enumerate(materials):
        picture = material.texture
        if picture is None or picture.ndim != 3 or picture.shape[2] < 3 or picture.size == 0:
            continue
        if id(picture) not in packed:
            first, level = len(mips), np.ascontiguousarray(picture[..., :3], dtype=np.uint8)
            while True:
                height, width = level.shape[:2]
                mips.append((offset, width, height))
                texels.append(level.reshape(-1, 3))
                offset += width * height
                if width == 1 and height == 1:
                    break
                level = cv2.resize(level, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA)
            packed[id(picture)] = (first, len(mips) - first)
        texture[index] = packed[id(picture)]
        smallest = texels[packed[id(picture)][0] + packed[id(picture)][1] - 1][0]
        mean_colors[index] *= LINEAR_OF_BYTE[smallest]
    all_texels = np.concatenate(texels) if texels else np.zeros((1, 3), dtype=np.uint8)
    all_mips = np.array(mips or [(0, 1, 1)], dtype=np.int64)
    return colors, texture, all_mips, all_texels, mean_colors
