"""MATLAB's files as raw logs: vectors are columns, matrices several, structs paths.

MathWorks publishes the formats ("MAT-File Format"). Version 4 has for each variable five integers (type,
rows, columns, whether it is complex, length of the name), the name, and its numbers column by column.
Versions 5 to 7 have elements of a type, a length and data, padded to 8 bytes; variables are elements of such.
Both are read here: SciPy's reader ends the program on some damaged files
(docs/decisions/0055-matlab-files.md).

Version 7.3 is an HDF5 file, read with h5py: structs are groups, and arrays have their axes in reverse order.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from etude.errors import DataError
from etude.logs.readers.extras import needed
from etude.logs.readers.frames import raw_log
from etude.logs.readers.memory_budget import BESIDE, BLOCK, MemoryBudget, as_float
from etude.types import Array, Log

HDF5 = (b"\x89HDF", b"MATLAB 7.3")
SIGNALS = ".signals.values"
HEAD = 128  # bytes of text before a MAT 5 file's data
WIDEST = 1000
"""Columns of a matrix: wider ones are images."""


def mat_log(path: Path) -> Log:
    """All numeric variables with one row for each sample; what has another length is left out and named.

    Raises:
        DataError: no MAT file, or without two variables of one length.
        UsageError: a file of version 7.3, and h5py is not installed.
    """
    columns = _simulink(dict(_columns(_loaded(path), "")))
    lengths = Counter(len(values) for values in columns.values() if len(values) > 1)
    if not lengths:
        raise DataError(
            "the file has no variable with more than one number",
            where=str(path),
            next_step="Save time, positions and commands as arrays with a row for each sample.",
        )
    rows = max(lengths, key=lambda n: (lengths[n], n))
    omitted = sorted(name for name, values in columns.items() if len(values) != rows)
    of_length = {name: values for name, values in columns.items() if len(values) == rows}
    of_length = _without_struct(of_length)
    sentence = f"Variables with another length than {rows} were ignored: {', '.join(omitted[:12])}."
    return raw_log(of_length, path.name, (sentence,) if omitted else ())


def _simulink(columns: dict[str, Array]) -> dict[str, Array]:
    """Signals that Simulink saved as structures with time (`q.time`, `q.signals.values_1`) under their own
    names, with the time that all of them share; as they are where times differ.
    """
    blocks = {name.partition(SIGNALS)[0] for name in columns if SIGNALS in name}
    times = [columns[f"{block}.time"] for block in blocks if f"{block}.time" in columns]
    if not times or not all(np.array_equal(times[0], t) for t in times):
        return columns
    renamed = {}
    for name, values in columns.items():
        if name.removesuffix(".time") not in blocks:
            renamed[name.replace(SIGNALS, "").rpartition(".")[2] if SIGNALS in name else name] = values
    return {"time": times[0], **renamed}


def _without_struct(columns: Mapping[str, Array]) -> dict[str, Array]:
    """The columns without the name of a struct that contains all of them: `log.q_1` is q_1."""
    heads = {name.partition(".")[0] for name in columns}
    if len(heads) != 1 or not all("." in name for name in columns):
        return dict(columns)
    return _without_struct({name.partition(".")[2]: values for name, values in columns.items()})


NUMBERS_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
HEADER_4 = 20  # bytes: five int32 before each matrix of a MAT 4 file
LONGEST_NAME = 1000  # longer ones are no MAT 4 header, but other bytes
FULL = 0
"""Kind of a matrix that is neither text nor sparse."""


def is_mat4(head: bytes) -> bool:
    """Whether a file begins with a variable of this format."""
    return _order(head) is not None


def variables4(file: BinaryIO, room: MemoryBudget) -> dict[str, Array]:
    """Name -> (rows, columns); complex numbers, text and sparse matrices are left out.

    Raises:
        ValueError, struct.error: damaged, or another format. DataError: there is no room for them.
    """
    matrices, place, whole = {}, 0, file.seek(0, os.SEEK_END)
    while place < whole:
        file.seek(place)
        head = file.read(HEADER_4)
        order = _order(head)
        if order is None:
            raise ValueError(f"byte {place} begins no variable")
        kind, rows, columns, parts, length = struct.unpack(f"{order}5i", head)
        number = np.dtype(order + NUMBERS_4[kind // 10 % 10])
        place += HEADER_4 + length + rows * columns * number.itemsize * (1 + parts)
        if place > whole:
            raise ValueError("a variable is longer than what is left")
        name = file.read(length).split(b"\0")[0].decode(errors="replace")
        if kind % 10 == FULL and not parts and rows and columns:
            room.take(rows * columns * np.dtype(np.float64).itemsize)
            matrices[name] = as_float(file.read, rows * columns, number).reshape((rows, columns), order="F")
    return matrices


def _order(head: bytes) -> str | None:
    """The order of bytes in which five integers make sense; None if in neither."""
    if len(head) < HEADER_4:
        return None
    for order, machine in (("<", 0), (">", 1)):
        kind, rows, columns, parts, length = struct.unpack_from(f"{order}5i", head)
        is_header = kind // 1000 == machine and kind // 100 % 10 == 0
        is_header &= kind // 10 % 10 < len(NUMBERS_4) and kind % 10 < 3 and parts in (0, 1)
        if is_header and min(kind, rows, columns) >= 0 and 0 < length <= LONGEST_NAME:
            return order
    return None


HEADER_5 = 128  # bytes of text, version and byte order
NUMBERS_5 = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15  # types of MAT 5 elements
STRUCT, NUMERIC = 2, range(6, 16)
"""Classes of arrays."""
DEEPEST = 8
"""Structs within structs."""

Variable = Array | Mapping[str, Any]


def variables(file: BinaryIO, room: MemoryBudget) -> dict[str, Variable]:
    """Name -> (rows, columns) numbers, or a mapping of such for a struct; all else is left out.

    Nothing of the file is held but the numbers: what is packed is unpacked block by block.

    Raises:
        ValueError, struct.error, zlib.error: damaged, or another format. DataError: they have no room.
    """
    head, size = file.read(HEADER_5), file.seek(0, os.SEEK_END)
    file.seek(HEADER_5)
    order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
    if order is None:
        raise ValueError("it does not begin as one")
    values = {}
    for kind, content in _elements(Bytes(file.read, size - HEADER_5), order):
        for name, value in _variable(kind, content, order, room):
            values[name] = value
    return values


@dataclass
class Bytes:
    """A sequence of bytes that is read in order.

    Attributes:
        source: returns at most so many bytes. left: remaining bytes; None: until the source ends.
        counted: whether they took their room already, as they were unpacked.
    """

    source: Callable[[int], bytes]
    left: int | None
    counted: bool = False

    def read(self, size: int) -> bytes:
        """Exactly so many bytes. ValueError: there are fewer."""
        if self.left is not None and size > self.left:
            raise ValueError("an element is longer than what is left")
        data = self.source(size)
        if len(data) < size:
            raise ValueError("an element is longer than what is left")
        if self.left is not None:
            self.left -= size
        return data

    def head(self) -> bytes:
        """The next 8 bytes; empty if the data end before."""
        data = b"" if self.left is not None and self.left < 8 else self.source(8)
        if self.left is not None and len(data) == 8:
            self.left -= 8
        return data if len(data) == 8 else b""

    def short(self) -> bytes:
        """All remaining bytes of a name or of a few numbers. ValueError: there are too many."""
        if self.left is None or self.left > BLOCK:
            raise ValueError("a name or a size is too long")
        return self.read(self.left)

    def skip(self) -> None:
        """Skip the bytes that were not read."""
        while self.left is None and self.source(BLOCK):
            pass
        while self.left:
            self.read(min(BLOCK, self.left))


class Inflated:
    """The unpacked data of a part; its size is counted while it is read."""

    def __init__(self, packed: Bytes, room: MemoryBudget) -> None:
        self._packed, self._room = packed, room
        self._unpacker, self._ahead = zlib.decompressobj(), bytearray()

    def read(self, size: int) -> bytes:
        """At most so many bytes: less at the end."""
        while len(self._ahead) < size and self._more():
            pass
        data = bytes(self._ahead[:size])
        del self._ahead[:size]
        return data

    def _more(self) -> bool:
        if self._unpacker.eof:
            return False
        packed = self._unpacker.unconsumed_tail or self._packed.read(min(BLOCK // 64, self._packed.left or 0))
        block = self._unpacker.decompress(packed, BLOCK)
        self._room.take(len(block))
        self._ahead += block
        return bool(packed or block)


def _variable(kind: int, content: Bytes, order: str, room: MemoryBudget) -> Iterator[tuple[str, Variable]]:
    if kind == COMPRESSED:
        inner = Bytes(Inflated(content, room).read, None, counted=True)
        for inner_kind, part in _elements(inner, order):
            if inner_kind != COMPRESSED:
                yield from _variable(inner_kind, part, order, room)
        inner.skip()  # to where its checksum stands
    elif kind == MATRIX:
        name, value = _matrix(content, order, 0, room)
        if value is not None:
            yield name, value


def _elements(part: Bytes, order: str) -> Iterator[tuple[int, Bytes]]:
    """Type and content of each element in turn; what is not read of one is left behind for the next."""
    while head := part.head():
        kind, size = struct.unpack(f"{order}II", head)
        if not kind:  # no type: zeros that fill the end
            return
        if kind >> 16:  # a small one, whose data stand in the length's place
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise ValueError("an element is longer than what is left")
            yield kind, Bytes(io.BytesIO(head[4:]).read, size)
            continue
        if part.left is not None and size > part.left:
            raise ValueError("an element is longer than what is left")
        element = Bytes(part.read, size, part.counted)
        yield kind, element
        element.skip()
        padding = 0 if kind == COMPRESSED else -size % 8
        if padding and (part.left is None or part.left >= padding):
            part.read(padding)


def _matrix(content: Bytes, order: str, depth: int, room: MemoryBudget) -> tuple[str, Variable | None]:
    """Name and value of an array; None for what is neither numbers nor a single struct of them."""
    parts = _elements(content, order)
    flags = _numbers(*_next(parts), order)
    dimensions = [int(n) for n in _numbers(*_next(parts), order)]
    name = _next(parts)[1].short().decode(errors="replace")
    kind, count = int(flags[0]) & 0xFF, int(np.prod(dimensions, dtype=object))
    if kind == STRUCT and count == 1 and depth < DEEPEST:
        return name, _struct(parts, order, depth, room)
    if kind not in NUMERIC or len(dimensions) != 2 or not count:
        return name, None
    values = _values(*_next(parts), count, order, room)
    return name, values.reshape(dimensions, order="F")


def _values(kind: int, content: Bytes, count: int, order: str, room: MemoryBudget) -> Array:
    """(count,) of an element that is as long."""
    number, size = _number(kind, order), content.left
    if size != count * number.itemsize:
        raise ValueError("an array is not as long as its dimensions say")
    whole = count * np.dtype(np.float64).itemsize
    room.require(whole)  # before anything of it is unpacked
    room.take(max(whole - size, 0) if content.counted else whole)
    return as_float(content.read, count, number)


def _struct(parts: Iterator[tuple[int, Bytes]], order: str, depth: int, room: MemoryBudget) -> dict[str, Any]:
    length = int(_numbers(*_next(parts), order)[0])
    text = _next(parts)[1].short()
    if length < 1:
        raise ValueError("a struct has fields without names")
    names = [text[i : i + length].split(b"\0")[0] for i in range(0, len(text), length)]
    values = {}
    for field in (name.decode(errors="replace") for name in names):
        kind, content = _next(parts)
        value = _matrix(content, order, depth + 1, room)[1] if kind == MATRIX and content.left else None
        if value is not None:
            values[field] = value
    return values


def _next(parts: Iterator[tuple[int, Bytes]]) -> tuple[int, Bytes]:
    part = next(parts, None)
    if part is None:
        raise ValueError("an array ends too early")
    return part


def _numbers(kind: int, content: Bytes, order: str) -> Array:
    """(n,) of an element of a few numbers, at least one."""
    values = np.frombuffer(content.short(), dtype=_number(kind, order))
    if not len(values):
        raise ValueError("an element without numbers")
    return np.asarray(values, dtype=np.float64)


def _number(kind: int, order: str) -> np.dtype[Any]:
    if kind not in NUMBERS_5:
        raise ValueError(f"type {kind} is not a number")
    return np.dtype(order + NUMBERS_5[kind])


@dataclass(frozen=True)
class Hdf5:
    """Reads the variables of a MAT file of version 7.3.

    Attributes:
        library: h5py. room: of the file. visited: addresses of objects: links may form a circle.
    """

    library: Any
    room: MemoryBudget
    visited: set[int]

    def variables(self, group: Any, depth: int = 0) -> dict[str, Variable]:
        """Name -> numbers of MATLAB's shape, or a mapping for a struct; all else is left out.

        Raises:
            ValueError: a block is damaged, or packed in a way that is not read. DataError: there is no room.
        """
        values: dict[str, Variable] = {}
        for name in group:
            if name.startswith("#") or not self._is_hard_link(group.get(name, getlink=True)):
                continue
            item = group[name]
            address = self.library.h5o.get_info(item.id).addr
            if address in self.visited:
                continue
            self.visited.add(address)
            value = self._value(item, depth)
            if value is not None:
                values[name] = value
        return values

    def _is_hard_link(self, link: Any) -> bool:
        """Whether the object is in this file: other links may name any file of the disk."""
        return isinstance(link, self.library.HardLink)

    def _value(self, item: Any, depth: int) -> Variable | None:
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode(errors="replace") if isinstance(kind, bytes) else str(kind)
        if any(mark in item.attrs for mark in NO_NUMBERS_73):
            return None
        if isinstance(item, self.library.Group):
            return self.variables(item, depth + 1) if kind in ("", "struct") and depth < DEEPEST else None
        if not isinstance(item, self.library.Dataset) or kind not in ("", *CLASSES_73):
            return None
        simple = item.dtype.kind in "iuf" and item.dtype.itemsize <= np.dtype(np.float64).itemsize
        return self._numbers(item) if simple and item.ndim in (1, 2) and item.size else None

    def _numbers(self, dataset: Any) -> Array:
        """(rows, columns) numbers of a dataset."""
        if dataset.external or dataset.is_virtual:
            raise ValueError("the numbers of a variable are in another file")
        self.room.take(int(dataset.size) * np.dtype(np.float64).itemsize)
        if dataset.chunks is not None:
            self._check_blocks(dataset)
        values = np.empty(dataset.shape)
        dataset.read_direct(values)
        return np.atleast_2d(values).T

    def _check_blocks(self, dataset: Any) -> None:
        """ValueError: a block unpacks to another size than it states. HDF5 would unpack all of it at once."""
        size = int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize
        self.room.require(size)
        properties = dataset.id.get_create_plist()
        filters = [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]
        if not set(filters) <= set(FILTERS_73) or len(set(filters)) < len(filters):
            raise ValueError("a variable has an encoding that is not read")
        blocks: list[Any] = []
        dataset.id.chunk_iter(blocks.append)
        for block in blocks if DEFLATE in filters else ():
            self.room.require(block.size)
            if block.filter_mask & 1 << filters.index(DEFLATE):  # this one is not packed
                continue
            _, data = dataset.id.read_direct_chunk(block.chunk_offset)
            if len(zlib.decompressobj().decompress(data, size + CHECKSUM + 1)) > size + CHECKSUM:
                raise ValueError("a block unpacks to more than it states")


CLASSES_73 = (
    "double",
    "single",
    "logical",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
)
NO_NUMBERS_73 = ("MATLAB_empty", "MATLAB_sparse", "MATLAB_object_decode")
"""Attributes of what has no numbers of its own."""
DEFLATE, SHUFFLE, FLETCHER = FILTERS_73 = (1, 2, 3)
"""Numbers of HDF5's own filters."""
CHECKSUM = 4  # bytes


def variables73(path: Path, room: MemoryBudget) -> Mapping[str, Variable]:
    """As `variables`, of a file of version 7.3.

    Raises:
        ValueError: damaged. DataError: the numbers have no room. UsageError: h5py is not installed.
    """
    h5py = needed(
        "h5py", "reading a MAT file of version 7.3", path, "or save it in MATLAB with save(name, '-v7')"
    )
    try:
        with h5py.File(path, "r") as file:
            return Hdf5(h5py, room, set()).variables(file)
    except (OSError, RuntimeError, LookupError, TypeError) as problem:  # what h5py makes of HDF5's errors
        raise ValueError(str(problem).partition("\n")[0]) from None


def _loaded(path: Path) -> Mapping[str, Variable]:
    try:
        room = MemoryBudget(path)
        values = _variables_of(path, room)
        room.require(BESIDE * max((_rows(value) for value in values.values()), default=0))
        return values
    except (ValueError, struct.error, zlib.error) as problem:
        raise DataError(
            f"the file cannot be read as MAT ({problem})",
            where=str(path),
            next_step="It is truncated or another kind of file; save it again, with '-v7'.",
        ) from None


def _variables_of(path: Path, room: MemoryBudget) -> Mapping[str, Variable]:
    with path.open("rb") as file:
        head = file.read(HEAD)
        if head.startswith(HDF5):
            return variables73(path, room)
        file.seek(0)
        return variables4(file, room) if is_mat4(head) else variables(file, room)


def _rows(value: Variable) -> int:
    """Rows of the longest array in it."""
    if isinstance(value, Mapping):
        return max((_rows(item) for item in value.values()), default=0)
    return int(max(value.shape))


def _columns(values: Mapping[str, Variable], prefix: str) -> Iterator[tuple[str, Array]]:
    """(path, (T,)) of every array of numbers; a matrix's columns are numbered from 1, as MATLAB does."""
    for name, value in values.items():
        if not name:  # MATLAB's own notes on objects
            continue
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{name}.")
            continue
        rows = value if value.shape[0] >= value.shape[1] else value.T
        if rows.shape[1] == 1:
            yield f"{prefix}{name}", rows[:, 0]
        elif rows.shape[1] <= WIDEST:
            yield from ((f"{prefix}{name}_{i}", column) for i, column in enumerate(rows.T, 1))
