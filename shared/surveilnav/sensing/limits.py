"""Limits of received data, and decompression that keeps to them."""

from __future__ import annotations

from typing import Final

import zstandard

from surveilnav.errors import WireError

#: A picture of 4096 x 4096 needs 48 MB as pixels and 64 MB as metric depth.
MAX_PIXELS: Final = 4096 * 4096
MAX_ARRAY_BYTES: Final = 256 * 1024 * 1024
#: Pixels a side of a cell of depth or of a mask.
MAX_DIVISOR: Final = 64


def check_pixels(width_px: int, height_px: int) -> None:
    """Raises WireError for a picture of no pixel, or of more than ``MAX_PIXELS``."""
    if width_px < 1 or height_px < 1 or width_px * height_px > MAX_PIXELS:
        raise WireError(f"a picture may have up to {MAX_PIXELS} pixels, got {width_px}x{height_px}")


def unzstd(data: bytes, n_bytes: int) -> bytes:
    """Decompresses one zstd frame of ``n_bytes``. The stated size is checked before anything is allocated.

    Raises:
        WireError: it isn't one, or has another size.
    """
    try:
        stated = zstandard.frame_content_size(data)
        if stated != n_bytes:
            raise WireError(f"expected zstd data of {n_bytes} bytes, it says it holds {stated}")
        raw: bytes = zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise WireError(f"the data can't be decompressed: {error}") from None
    if len(raw) != n_bytes:
        raise WireError(f"expected {n_bytes} bytes, got {len(raw)}")
    return raw
