"""A file of a megabyte that would fill the machine's memory: refused, in each format that packs."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from mat_examples import write73
from scipy.io import loadmat, savemat, whosmat

from etude.errors import DataError
from etude.logs import read_raw
from etude.logs.readers import memory_budget
from etude.logs.readers.memory_budget import unpacked
from etude.storage import arrays_of, packed

SMALL = 2**24
"""Bytes that stand for the gigabyte, so that the tests cost no memory."""
ROWS = SMALL // 8 // 4
BLOCK = 2**20


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_budget, "LARGEST", SMALL)


def matrix(name: str, rows: int, kind: int, size: int) -> bytes:
    """An element of a MAT file: a vector of zeros of a type of numbers."""

    def element(type_: int, data: bytes) -> bytes:
        return struct.pack("<II", type_, len(data)) + data + bytes(-len(data) % 8)

    flags, dimensions = struct.pack("<II", 6, 0), struct.pack("<ii", rows, 1)
    parts = element(6, flags) + element(5, dimensions) + element(1, name.encode())
    return (
        struct.pack("<II", 14, 0)[:4]
        + struct.pack("<I", len(parts) + 8 + rows * size)
        + parts
        + element(kind, bytes(rows * size))
    )


def mat(path: Path, *variables: bytes) -> Path:
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    data = b"".join(struct.pack("<II", 15, len(p := zlib.compress(own))) + p for own in variables)
    path.write_bytes(head + data)
    return path


def test_a_mat_whose_variables_are_small_each_and_too_many_together(tmp_path: Path) -> None:
    one = [matrix(f"v{i}", ROWS, 9, 8) for i in range(5)]
    assert len(read_raw(mat(tmp_path / "fits.mat", one[0]))) == ROWS
    with pytest.raises(DataError, match="unpacks to more than"):
        read_raw(mat(tmp_path / "bomb.mat", *one))


def test_a_mat_of_bytes_counts_as_the_numbers_that_they_become(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="unpacks to more than"):
        read_raw(mat(tmp_path / "bytes.mat", *(matrix(f"v{i}", 2 * ROWS, 2, 1) for i in range(3))))


def peak_of(path: Path) -> int:
    """Bytes held at most at once while it is refused."""
    tracemalloc.start()
    try:
        with pytest.raises(DataError, match="unpacks to more than"):
            read_raw(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def text(name: str, size: int) -> bytes:
    """A variable that is no numbers, and is left out."""
    return matrix(name, size, 2, 1).replace(
        struct.pack("<IIII", 6, 8, 6, 0), struct.pack("<IIII", 6, 8, 4, 0)
    )


@pytest.mark.parametrize(
    ("variables", "most"),
    [
        (lambda: [matrix("q", SMALL // 2, 9, 8)], 5 * BLOCK),
        (lambda: [matrix("q", 4 * SMALL, 2, 1)], 5 * BLOCK),
        (lambda: [matrix(f"v{i}", ROWS // 4, 9, 8) for i in range(40)], SMALL + 5 * BLOCK),
        (lambda: [text("x", 4 * SMALL)], 5 * BLOCK),
        (lambda: [matrix("q", 2, 9, 8) + bytes(4 * SMALL)], 5 * BLOCK),
    ],
    ids=["doubles", "bytes", "many", "left out", "behind"],
)
def test_a_mat_is_refused_before_it_fills_the_memory(
    tmp_path: Path, variables: Callable[[], list[bytes]], most: int
) -> None:
    """Whatever it states: one large variable, many that are small, or what is not read at all."""
    # made here: as parameters, half a gigabyte would stay in each worker until the end
    path = mat(tmp_path / "bomb.mat", *variables())
    assert path.stat().st_size < SMALL / 32
    assert peak_of(path) < most


@pytest.mark.parametrize("dtype", ["f8", "u1"])
def test_a_mat_of_version_73_is_refused_before_it_is_unpacked(tmp_path: Path, dtype: str) -> None:
    """One large variable, and many that are small."""
    pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    rows = 2 * SMALL // 8
    for own, most in (
        ({"q": np.zeros(rows, dtype)}, 5 * BLOCK),
        ({f"v{i}": np.zeros(ROWS // 4, dtype) for i in range(40)}, SMALL + 5 * BLOCK),
    ):
        path = write73(tmp_path / "bomb.mat", own)
        assert path.stat().st_size < SMALL / 32
        assert peak_of(path) < most


@pytest.mark.parametrize("how", [{}, {"shuffle": True}, {"fletcher32": True}], ids=["", "shuffle", "sum"])
def test_a_block_of_version_73_that_states_less_than_it_holds(tmp_path: Path, how: dict[str, bool]) -> None:
    """HDF5 unpacks a block whole, whatever its size is said to be."""
    h5py = pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    path = write73(tmp_path / "bomb.mat", {"t": np.arange(1000.0), "q": np.zeros(1000)}, **how)
    assert len(read_raw(path)) == 1000
    with h5py.File(path, "r+") as file:
        file["q"].id.write_direct_chunk((0, 0), zlib.compress(bytes(4 * SMALL)))
    with pytest.raises(DataError, match="unpacks to more than it states"):
        read_raw(path)


def test_packings_of_version_73_that_matlab_does_not_write(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    own = {"t": np.arange(1000.0), "q": np.zeros(1000)}
    path = write73(tmp_path / "lzf.mat", own, compression="lzf", compression_opts=None)
    with pytest.raises(DataError, match="has an encoding that is not read"):
        read_raw(path)


def test_scipys_reader_holds_what_a_struct_unpacks_to(tmp_path: Path) -> None:
    """Nothing states its size before; one of the reasons in docs/decisions/0055-matlab-files.md."""
    savemat(tmp_path / "bomb.mat", {"log": {"q": np.zeros(2 * SMALL // 8)}}, do_compression=True)
    assert peak_of(tmp_path / "bomb.mat") < 5 * BLOCK
    assert whosmat(tmp_path / "bomb.mat") == [("log", (1, 1), "struct")]
    tracemalloc.start()
    try:
        loadmat(tmp_path / "bomb.mat")
        assert tracemalloc.get_traced_memory()[1] > 2 * SMALL
    finally:
        tracemalloc.stop()


def test_an_older_mat_is_refused_before_it_is_read(tmp_path: Path) -> None:
    data = np.zeros(2 * SMALL // 8).tobytes()
    path = tmp_path / "old.mat"
    path.write_bytes(struct.pack("<5i", 0, len(data) // 8, 1, 0, 2) + b"q\0" + data)
    assert peak_of(path) < SMALL / 4


def test_text_that_repeats_counts_as_often_as_it_stands_there(tmp_path: Path) -> None:
    path = tmp_path / "text.parquet"
    pl.DataFrame({"a": ["x" * 1000] * (SMALL // 500), "b": np.zeros(SMALL // 500)}).write_parquet(path)
    assert path.stat().st_size < SMALL / 100
    peak_of(path)


def test_lists_count_their_entries(tmp_path: Path) -> None:
    path = tmp_path / "lists.parquet"
    pl.DataFrame({"position": [[0.0] * 100] * (SMALL // 1600)}).write_parquet(path)
    assert path.stat().st_size < SMALL / 100
    peak_of(path)


def test_a_table_of_run_lengths(tmp_path: Path) -> None:
    path = tmp_path / "zeros.parquet"
    pl.DataFrame({name: np.zeros(ROWS) for name in "abcde"}).write_parquet(path)
    assert path.stat().st_size < SMALL // 100
    with pytest.raises(DataError, match="unpacks to more than"):
        read_raw(path)
    pl.DataFrame({"a": np.zeros(ROWS)}).write_parquet(path)
    assert len(read_raw(path)) == ROWS


def test_what_unpacks_without_end_is_counted_on_the_way(tmp_path: Path) -> None:
    zstd = pytest.importorskip("backports.zstd", reason="zstd comes with the extra ros")
    lz4 = pytest.importorskip("lz4.frame", reason="lz4 comes with the extra ros")
    data = bytes(2 * SMALL)
    for own, unpacker in (
        (zstd.compress(data), zstd.ZstdDecompressor()),
        (lz4.compress(data), lz4.LZ4FrameDecompressor()),
    ):
        with pytest.raises(DataError, match="unpacks to more than"):
            unpacked(unpacker, own, tmp_path)
    few = zstd.compress(data[:1000])
    assert unpacked(zstd.ZstdDecompressor(), few, tmp_path) == data[:1000]


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_chunk_of_a_bag(tmp_path: Path, packing: str) -> None:
    zstd = pytest.importorskip("backports.zstd", reason="zstd comes with the extra ros")
    lz4 = pytest.importorskip("lz4.frame", reason="lz4 comes with the extra ros")
    # half of it is noise, so that the chunk is long enough to be looked at
    noise = np.random.default_rng(0).bytes(2**17)
    records = (zstd if packing == "zstd" else lz4).compress(noise + bytes(2 * SMALL))
    name = packing.encode()
    chunk = struct.pack("<QQQI", 0, 1, 100, 0) + struct.pack("<I", len(name)) + name
    chunk += struct.pack("<Q", len(records)) + records
    magic = b"\x89MCAP0\r\n"
    path = tmp_path / "bag.mcap"
    path.write_bytes(magic + b"\x06" + struct.pack("<Q", len(chunk)) + chunk + bytes(0) + magic)
    assert peak_of(path) < SMALL


def test_arrays_of_a_model(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = {"a": np.zeros(1000)}
    np.testing.assert_equal(arrays_of(packed(arrays)), arrays)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        own = io.BytesIO()
        np.save(own, arrays["a"])
        archive.writestr("a.npy", own.getvalue())
    assert len(buffer.getvalue()) < 1000
    np.testing.assert_equal(arrays_of(buffer.getvalue()), arrays)
    monkeypatch.setattr("etude.storage.LARGEST_ARRAYS", 8000)
    with pytest.raises(ValueError, match="exceed 1 GB"):
        arrays_of(buffer.getvalue())
