"""MATLAB's older binary format, version 4, as far as logs need it: full matrices of real numbers.

The format is published by MathWorks ("MAT-File Format", level 4): of each variable five integers (type, rows,
columns, whether it is complex, length of the name), the name, and its numbers column by column.
"""

from __future__ import annotations

import os
import struct
from typing import BinaryIO

import numpy as np

from etude.logs.readers.unpacking import Room, as_float
from etude.types import Array

NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
HEADER = 20
LONGEST_NAME = 1000
FULL = 0
"""Kind of a matrix that is neither text nor sparse."""


def is_mat4(head: bytes) -> bool:
    """Whether a file begins with a variable of this format."""
    return _order(head) is not None


def variables4(file: BinaryIO, room: Room) -> dict[str, Array]:
    """Name -> (rows, columns); complex numbers, text and sparse matrices are left out.

    Raises:
        ValueError, struct.error: damaged, or another format. DataError: there is no room for them.
    """
    found, place, whole = {}, 0, file.seek(0, os.SEEK_END)
    while place < whole:
        file.seek(place)
        head = file.read(HEADER)
        order = _order(head)
        if order is None:
            raise ValueError(f"byte {place} begins no variable")
        kind, rows, columns, parts, length = struct.unpack(f"{order}5i", head)
        number = np.dtype(order + NUMBERS[kind // 10 % 10])
        place += HEADER + length + rows * columns * number.itemsize * (1 + parts)
        if place > whole:
            raise ValueError("a variable is longer than what is left")
        name = file.read(length).split(b"\0")[0].decode(errors="replace")
        if kind % 10 == FULL and not parts and rows and columns:
            room.take(rows * columns * np.dtype(np.float64).itemsize)
            found[name] = as_float(file.read, rows * columns, number).reshape((rows, columns), order="F")
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
