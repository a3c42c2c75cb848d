"""The joint maps as bytes and back: MessagePack of plain values and arrays, compressed with zstd, with a version. No pickle.

``freeze`` copies what will change, quickly, while nobody integrates; ``pack`` then takes its time while the maps go on.
"""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec
import numpy as np
import zstandard

from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.joint_map import JointMap

#: Version of what a snapshot holds; snapshots of other versions aren't read.
VERSION = 5
_MAX_BYTES = 8 << 30


class SnapshotError(ValueError):
    """Bytes that are no snapshot these maps can go on from; ``name``: corrupt, other_version or other_config."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


def dump(joint: JointMap) -> bytes:
    """The joint maps as bytes: the same for the same maps."""
    return pack(freeze(joint))


def load(data: bytes, config: FusionConfig) -> JointMap:
    """The joint maps that ``dump`` stored.

    Raises:
        SnapshotError: damaged, of another version, or with cells or voxels of another size than ``config`` says.
    """
    return thaw(unpack(data), config)


def freeze(joint: JointMap) -> dict[str, Any]:
    """A copy of everything in the maps, which may change from then on."""
    return {"version": VERSION, "sizes": _sizes(joint.config), "maps": joint.state()}


def thaw(frozen: dict[str, Any], config: FusionConfig) -> JointMap:
    """The joint maps of which ``freeze`` made a copy. SnapshotError: as ``load``."""
    if frozen.get("version") != VERSION:
        raise SnapshotError("other_version", f"expected a snapshot of version {VERSION}, got {frozen.get('version')!r}")
    if frozen.get("sizes") != _sizes(config):
        raise SnapshotError("other_config", f"the maps were made with {frozen.get('sizes')}, set is {_sizes(config)}")
    try:
        return JointMap.from_state(frozen["maps"], config)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise SnapshotError("corrupt", f"the snapshot lacks something: {type(error).__name__}: {error}") from error


def pack(value: Any) -> bytes:
    """Bytes of plain values, messages and arrays; a checksum is part of them."""
    return zstandard.ZstdCompressor(level=1, write_checksum=True).compress(_plain(value))


def digest(frozen: dict[str, Any]) -> str:
    """BLAKE2b (hex) of a copy of maps: equal for maps that are equal to the bit."""
    return hashlib.blake2b(_plain(frozen), digest_size=16).hexdigest()


def _plain(value: Any) -> bytes:
    return msgspec.msgpack.encode(value, enc_hook=_array_out)


def unpack(data: bytes) -> Any:
    """The value that ``pack`` stored, with dictionaries for messages and lists for tuples. SnapshotError: damaged bytes."""
    try:
        size = zstandard.frame_content_size(data)
        if not 0 <= size <= _MAX_BYTES:
            raise SnapshotError("corrupt", f"a snapshot has up to {_MAX_BYTES} bytes, this says {size}")
        return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data), ext_hook=_array_in)
    except (zstandard.ZstdError, msgspec.DecodeError, ValueError, TypeError) as error:
        if isinstance(error, SnapshotError):
            raise
        raise SnapshotError("corrupt", f"the bytes can't be read: {error}") from error


def _sizes(config: FusionConfig) -> dict[str, float]:
    """The settings without which the counts in a map mean nothing."""
    return {"resolution_m": config.map.resolution_m, "voxel_m": config.map.voxel_m}


def _array_out(value: Any) -> msgspec.msgpack.Ext:
    if isinstance(value, np.generic):
        value = np.asarray(value)
    if not isinstance(value, np.ndarray) or value.dtype.hasobject:
        raise NotImplementedError(f"a snapshot holds plain values and arrays, got a {type(value).__name__}")
    header = msgspec.msgpack.encode((value.dtype.str, value.shape))
    return msgspec.msgpack.Ext(1, len(header).to_bytes(4, "little") + header + np.ascontiguousarray(value).tobytes())


def _array_in(code: int, data: memoryview) -> Any:
    if code != 1:
        raise ValueError(f"expected an array, got extension {code}")
    n = int.from_bytes(data[:4], "little")
    dtype, shape = msgspec.msgpack.decode(data[4 : 4 + n])
    return np.frombuffer(data[4 + n :], np.dtype(dtype)).reshape(shape).copy()
