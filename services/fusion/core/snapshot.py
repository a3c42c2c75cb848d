"""The joint maps as bytes and back: plain values and arrays as MessagePack, compressed with zstd, with a version. No pickle.

``freeze`` quickly copies what may change, while nothing is integrated; ``pack`` then takes its time while the maps change.
"""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec
import numpy as np
import zstandard

from surveilnav.services.fusion.core.config import FusionConfig
from surveilnav.services.fusion.core.joint_map import JointMap

#: Version of a snapshot's contents; snapshots of other versions aren't read.
VERSION = 9
_MAX_BYTES = 8 << 30


class SnapshotError(ValueError):
    """A snapshot that can't be restored; ``name`` says why: corrupt, other_version or other_config."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


def dump(joint: JointMap) -> bytes:
    """The joint maps as bytes; equal maps give equal bytes."""
    return pack(freeze(joint))


def load(data: bytes, config: FusionConfig) -> JointMap:
    """The joint maps that ``dump`` stored.

    Raises:
        SnapshotError: the bytes are damaged, of another version, or of maps with another size of cells or voxels.
    """
    return thaw(unpack(data), config)


def freeze(joint: JointMap) -> dict[str, Any]:
    """A copy of everything in the maps. The maps may change afterwards."""
    return {"version": VERSION, "sizes": _sizes(joint.config), "maps": joint.state()}


def thaw(frozen: dict[str, Any], config: FusionConfig) -> JointMap:
    """The joint maps that ``freeze`` copied. SnapshotError: as in ``load``."""
    if not isinstance(frozen, dict):
        raise SnapshotError("corrupt", f"a snapshot is a table, this is a {type(frozen).__name__}")
    if frozen.get("version") != VERSION:
        raise SnapshotError("other_version", f"expected a snapshot of version {VERSION}, got {frozen.get('version')!r}")
    if frozen.get("sizes") != _sizes(config):
        raise SnapshotError("other_config", f"the maps were made with {frozen.get('sizes')}, set is {_sizes(config)}")
    try:
        return JointMap.from_state(frozen["maps"], config)
    except Exception as error:  # of any type: values of the wrong kind get as far as compiled loops
        raise SnapshotError("corrupt", f"the snapshot lacks something: {type(error).__name__}: {error}") from error


def pack(value: Any) -> bytes:
    """Plain values, messages and arrays as compressed bytes with a checksum."""
    return zstandard.ZstdCompressor(level=1, write_checksum=True).compress(_encode(value))


def digest(frozen: dict[str, Any]) -> str:
    """BLAKE2b (hex) of a copy of maps; equal exactly for maps that are equal bit by bit."""
    return hashlib.blake2b(_encode(frozen), digest_size=16).hexdigest()


def _encode(value: Any) -> bytes:
    return msgspec.msgpack.encode(value, enc_hook=_encode_array)


def unpack(data: bytes) -> Any:
    """The value that ``pack`` stored, with dictionaries for messages and lists for tuples. SnapshotError: damaged bytes."""
    try:
        size = zstandard.frame_content_size(data)
        if not 0 <= size <= _MAX_BYTES:
            raise SnapshotError("corrupt", f"a snapshot has up to {_MAX_BYTES} bytes, this says {size}")
        return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data), ext_hook=_decode_array)
    except (zstandard.ZstdError, msgspec.DecodeError, ValueError, TypeError) as error:
        if isinstance(error, SnapshotError):
            raise
        raise SnapshotError("corrupt", f"the bytes can't be read: {error}") from error


def _sizes(config: FusionConfig) -> dict[str, float]:
    """The settings that give the counts in a map their meaning."""
    return {"resolution_m": config.map.resolution_m, "voxel_m": config.map.voxel_m}


def _encode_array(value: Any) -> msgspec.msgpack.Ext:
    if isinstance(value, np.generic):
        value = np.asarray(value)
    if not isinstance(value, np.ndarray) or value.dtype.hasobject:
        raise NotImplementedError(f"a snapshot holds plain values and arrays, got a {type(value).__name__}")
    header = msgspec.msgpack.encode((value.dtype.str, value.shape))
    return msgspec.msgpack.Ext(1, len(header).to_bytes(4, "little") + header + np.ascontiguousarray(value).tobytes())


def _decode_array(code: int, data: memoryview) -> Any:
    if code != 1:
        raise ValueError(f"expected an array, got extension {code}")
    n = int.from_bytes(data[:4], "little")
    dtype, shape = msgspec.msgpack.decode(data[4 : 4 + n])
    return np.frombuffer(data[4 + n :], np.dtype(dtype)).reshape(shape).copy()
