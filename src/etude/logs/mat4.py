"""MATLAB's older binary format, version 4, as far as logs need it: full matrices of real numbers.

The format is published by MathWorks ("MAT-File Format", level 4): of each variable five integers (type, rows,
columns, whether it is complex, length of the name), the name, and its numbers column by column.
"""

from __future__ import annotations

import struct

import numpy as np

from etude.logs.unpacking import Room
from etude.types import Array

NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
HEADER = 20
LONGEST_NAME = 1000
FULL = 0
"""Kind of a matrix that is neither text nor sparse."""


def is_mat4(data: bytes) -> bool:
    """Whether a file begins with a variable of this format."""
    return _order(data) is not None


def variables4(data: bytes, room: Room) -> dict[str, Array]:
    """Name -> (rows, columns); complex numbers, text and sparse matrices are left out.

    Raises:
        ValueError, struct.error: damaged, or another format. DataError: there is no room for them.
    """
    found, place = {}, 0
    while place < len(data):
        order = _order(data[place : place + HEADER])
        if order is None:
            raise ValueError(f"byte {place} begins no variable")
        kind, rows, columns, parts, length = struct.unpack_from(f"{order}5i", data, place)
        number = np.dtype(order + NUMBERS[kind // 10 % 10])
        start, size = place + HEADER + length, rows * columns * number.itemsize
        end = start + size * (1 + parts)
        if end > len(data):
            raise ValueError("a variable is longer than what is left")
        name = data[place + HEADER : start].split(b"\0")[0].decode(errors="replace")
        if kind % 10 == FULL and not parts and rows and columns:
            room.take(rows * columns * np.dtype(np.float64).itemsize)
            values = np.frombuffer(data, number, rows * columns, start).astype(np.float64)
            found[name] = values.reshape((rows, columns), order="F")
        place = end
    return found


def _order(head: bytes) -> str | None:
    """The order of bytes in which five integers make sense; None if in neither."""
    if len(head) < HEADER:
        return None
    for order, machine in (("<", 0), (">", 1)):
        kind, rows, columns, parts, length = struct.unpack_from(f"{order}5i", head)
        known = kind // 1000 == machine and kind // 100 % 10 == 0
        known &= kind // 10 % 10 < len(NUMBERS) and kind % 10 < 3 and parts in (0, 1)
        if known and min(kind, rows, columns) >= 0 and 0 < length <= LONGEST_NAME:
            return order
    return None
