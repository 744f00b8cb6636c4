"""Heat maps as small PNG pictures (48 x 48 values: 3 kB, as rectangles 150 kB), with a legend."""

from __future__ import annotations

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from etude.report.markup import Html, number, text, with_unit
from etude.types import Array

STOPS = np.array(
    [
        [0, 34, 78],
        [18, 53, 112],
        [59, 73, 108],
        [87, 93, 109],
        [112, 113, 115],
        [138, 134, 120],
        [165, 156, 116],
        [195, 179, 105],
        [225, 204, 85],
        [254, 232, 56],
    ],
    dtype=float,
)
"""Cividis (Nunez, Anderton, Renslow 2018): reads the same with and without colour-blindness, and in grey."""


VIRIDIS = np.array(
    [
        [68, 1, 84],
        [72, 40, 120],
        [62, 74, 137],
        [49, 104, 142],
        [38, 130, 142],
        [31, 158, 137],
        [53, 183, 121],
        [110, 206, 88],
        [181, 222, 43],
        [253, 231, 37],
    ],
    dtype=float,
)
"""Viridis (van der Walt, Smith 2015), as safe, and never grey: for thin lines on light or dark paper."""


def colours(values: Array, stops: Array = STOPS) -> NDArray[np.uint8]:
    """RGB (..., 3) of values in [0, 1] on the scale `stops`; values outside are clipped."""
    position = np.clip(values, 0.0, 1.0) * (len(stops) - 1)
    channels = [np.interp(position, np.arange(len(stops)), stops[:, c]) for c in range(3)]
    return np.asarray(np.stack(channels, axis=-1).round(), dtype=np.uint8)


def png_address(pixels: NDArray[np.uint8]) -> str:
    """A data: address of an 8-bit RGB picture (rows, columns, 3), first row on top; PNG as in RFC 2083."""
    rows, columns, _ = pixels.shape
    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    scanlines = np.concatenate([np.zeros((rows, 1), np.uint8), pixels.reshape(rows, -1)], axis=1)
    content = _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(scanlines.tobytes(), 9))
    file = b"\x89PNG\r\n\x1a\n" + content + _chunk(b"IEND", b"")
    return "data:image/png;base64," + base64.b64encode(file).decode("ascii")


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def colour_bar(low: float, high: float, unit: str, stops: Array = STOPS) -> Html:
    """SVG of the legend under a panel's title, with the values at both ends."""
    ramp = png_address(colours(np.linspace(0.0, 1.0, 64)[None, :], stops))
    return Html(
        f'<text class="tick" x="60" y="36" text-anchor="end">{number(low, 2)}</text>'
        f'<image x="66" y="26" width="110" height="11" preserveAspectRatio="none" href="{ramp}"/>'
        f'<text class="tick" x="182" y="36">{text(with_unit(high, unit, 2))}</text>'
    )
