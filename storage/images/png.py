"""PNG encoder, several times as fast as pillow's, for files a fifth larger; isal does the compression."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

import numpy as np

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOR_TYPES = {3: 2, 4: 6}
"""Number of channels -> color type of PNG: RGB, or RGB with straight alpha."""
_SUB_FILTER = 1
"""Filter type Sub: each pixel is stored as the difference to its left neighbor, which suits smooth shading."""
METRES_PER_INCH = 0.0254
_COMPRESSION_LEVEL = 1
"""Of the four levels of isal: files are as small as with any, in 2 ms for 512x512."""


def encode_png(picture: np.ndarray, text: Mapping[str, str], dpi: float | None = None) -> bytes:
    """The PNG file of a picture (H, W, 3 or 4) uint8, straight sRGB, with text chunks {keyword: text}, in ASCII.

    `dpi`, the pixels of an inch on paper, becomes the chunk pHYs, which counts whole pixels of a metre.
    """
    from isal import isal_zlib

    height, width, channels = picture.shape
    rows = np.empty((height, 1 + width * channels), np.uint8)
    rows[:, 0] = _SUB_FILTER
    rows[:, 1 : 1 + channels] = picture[:, 0]
    np.subtract(picture[:, 1:], picture[:, :-1], out=rows[:, 1 + channels :].reshape(height, width - 1, channels))
    header = struct.pack(">IIBBBBB", width, height, 8, _COLOR_TYPES[channels], 0, 0, 0)
    texts = [_chunk(b"tEXt", f"{keyword}\0{value}".encode("ascii")) for keyword, value in text.items()]
    if dpi is not None:
        per_metre = round(dpi / METRES_PER_INCH)
        texts.insert(0, _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)))
    packed = isal_zlib.compress(rows, _COMPRESSION_LEVEL)
    return b"".join([_SIGNATURE, _chunk(b"IHDR", header), *texts, _chunk(b"IDAT", packed), _chunk(b"IEND", b"")])


def encode_png16(numbers: np.ndarray) -> bytes:
    """The PNG file of numbers (H, W) or (H, W, 3) uint16, with 16 bits a channel."""
    from isal import isal_zlib

    height, width = numbers.shape[:2]
    wide = numbers.reshape(height, width, -1).astype(">u2")
    rows = np.zeros((height, 1 + wide.shape[2] * 2 * width), np.uint8)  # filter type None
    rows[:, 1:] = wide.view(np.uint8).reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 16, 0 if numbers.ndim == 2 else 2, 0, 0, 0)
    packed = isal_zlib.compress(rows, _COMPRESSION_LEVEL)
    return b"".join([_SIGNATURE, _chunk(b"IHDR", header), _chunk(b"IDAT", packed), _chunk(b"IEND", b"")])


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
