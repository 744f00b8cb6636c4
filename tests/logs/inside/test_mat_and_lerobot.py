"""MATLAB's files and LeRobot's datasets."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE, make_log
from mat_examples import write73
from scipy.io import loadmat, savemat

from etude.errors import DataError, UsageError
from etude.logs import read_log, read_raw
from etude.logs.readers.mat import is_mat4, variables, variables4
from etude.logs.readers.memory_budget import MemoryBudget
from etude.types import Log

LOG = make_log()
ROWS = len(LOG)


def read(path: Path, *topics: str) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS, topics=topics)


@pytest.mark.parametrize("compressed", [True, False])
def test_matrices_of_a_mat_file(compressed: bool, tmp_path: Path) -> None:
    """Samples in rows or in columns; what has another length is left out and named."""
    own = {"t": LOG.t, "q": LOG["q"], "tau": LOG["command"].T, "gains": np.ones(7)}
    savemat(tmp_path / "run.mat", own, do_compression=compressed)
    log = read(tmp_path / "run.mat")
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])
    assert any("ignored: gains" in sentence for sentence in log.repairs)


def test_matrices_of_version_4(tmp_path: Path) -> None:
    """As SciPy writes them; complex numbers and text are left out."""
    own = {"t": LOG.t, "q": LOG["q"], "tau": LOG["command"].T, "note": "run 3", "roots": np.ones(3) * 1j}
    savemat(tmp_path / "run.mat", own, format="4")
    log = read(tmp_path / "run.mat")
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<i4", ">i2", "<u2", "|u1"])
def test_numbers_of_version_4(dtype: str) -> None:
    values = np.arange(6).reshape(2, 3).astype(dtype)
    machine = 1000 * (dtype[0] == ">")
    kind = machine + 10 * ("f8", "f4", "i4", "i2", "u2", "u1").index(dtype[1:])
    head = np.array([kind, 2, 3, 0, 2], dtype=">i4" if machine else "<i4").tobytes()
    data = head + b"q\0" + values.tobytes(order="F")
    assert is_mat4(data)
    np.testing.assert_array_equal(variables4(io.BytesIO(data * 2), MemoryBudget(Path()))["q"], values)
    with pytest.raises(ValueError, match="longer than what is left"):
        variables4(io.BytesIO(data[:-1]), MemoryBudget(Path()))
    with pytest.raises(ValueError, match=r"byte .* begins no variable"):
        variables4(io.BytesIO(data + b"\1" * 30), MemoryBudget(Path()))


def test_version_5_is_not_taken_for_version_4(tmp_path: Path) -> None:
    savemat(tmp_path / "run.mat", {"t": LOG.t})
    assert not is_mat4((tmp_path / "run.mat").read_bytes())
    assert not is_mat4(b"")


def test_what_matlab_notes_of_objects_is_no_column(tmp_path: Path) -> None:
    """It stands in a variable without a name."""
    savemat(tmp_path / "run.mat", {"t": LOG.t, "q": LOG["q"], "zz": np.ones((2 * ROWS, 1))})
    data = (tmp_path / "run.mat").read_bytes()
    (tmp_path / "run.mat").write_bytes(data.replace(b"\x01\x00\x02\x00zz", b"\x01\x00\x00\x00\0\0"))
    raw = read_raw(tmp_path / "run.mat")
    assert set(raw.values) == {"t", "q_1", "q_2", "q_3"}
    assert raw.repairs == ()


def test_structs_of_a_mat_file(tmp_path: Path) -> None:
    state = {
        f"{word}_{j}": LOG[c][:, k]
        for word, c in (("q", "q"), ("tau", "command"))
        for k, j in enumerate(JOINTS)
    }
    savemat(tmp_path / "run.mat", {"time": LOG.t, "state": state})
    np.testing.assert_array_equal(read(tmp_path / "run.mat")["q"], LOG["q"])


def test_structures_with_time_of_simulink(tmp_path: Path) -> None:
    """One for each block `To Workspace`, alone or in a struct of all."""
    own = {
        name: {"time": LOG.t, "signals": {"values": values, "label": name}}
        for name, values in (("q", LOG["q"]), ("tau", LOG["command"]))
    }
    for run in (own, {"out": own}):
        savemat(tmp_path / "run.mat", run)
        log = read(tmp_path / "run.mat")
        np.testing.assert_array_equal(log["q"], LOG["q"])
        np.testing.assert_array_equal(log["command"], LOG["command"])
        np.testing.assert_allclose(log.t, LOG.t)


@pytest.mark.parametrize("beside", [{}, {"dt": 0.01, "gains": np.ones(7)}])
def test_a_struct_that_holds_all_is_no_part_of_the_names(beside: dict[str, object], tmp_path: Path) -> None:
    """As `save('run.mat', 'log')` leaves it."""
    own = {"time": LOG.t, "q": LOG["q"], "tau": LOG["command"]}
    savemat(tmp_path / "run.mat", {"out": {"log": own}, **beside})
    log = read(tmp_path / "run.mat")
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])


def test_variables_are_those_of_scipy(tmp_path: Path) -> None:
    """Types of numbers, small ones, structs in structs, and what is no number, against SciPy's reader."""
    rng = np.random.default_rng(0)
    own = {name: rng.integers(0, 100, (5, 3)).astype(name) for name in ("int8", "uint16", "int32", "float32")}
    own |= {"one": 7.0, "text": "elbow", "cells": np.array([1, "a"], dtype=object), "empty": np.zeros((0, 3))}
    savemat(tmp_path / "run.mat", {**own, "outer": {"inner": {"q": np.arange(4.0)}, "name": "ur10"}})
    with (tmp_path / "run.mat").open("rb") as file:
        found = variables(file, MemoryBudget(tmp_path))
    theirs = loadmat(tmp_path / "run.mat")
    for name in ("int8", "uint16", "int32", "float32", "one"):
        np.testing.assert_array_equal(found[name], theirs[name])
    assert set(found) == {"int8", "uint16", "int32", "float32", "one", "outer"}
    np.testing.assert_array_equal(found["outer"]["inner"]["q"], np.arange(4.0)[None])


def test_version_73_is_read_as_version_5(tmp_path: Path) -> None:
    """Matrices, structs, Simulink's structures with time, and numbers of other types."""
    pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    block = {"time": LOG.t[:, None], "signals": {"values": LOG["q"]}}
    for run in (
        {"t": LOG.t, "q": LOG["q"], "tau": LOG["command"].T, "gains": np.ones(7), "on": np.ones(ROWS) > 0.0},
        {"out": {"log": {"time": LOG.t, "q": LOG["q"].astype("f4"), "tau": LOG["command"]}}, "dt": 0.01},
        {"q": block, "tau": {**block, "signals": {"values": LOG["command"]}}, "n": np.arange(9, dtype="u2")},
    ):
        savemat(tmp_path / "5.mat", run)
        wanted, found = read_raw(tmp_path / "5.mat"), read_raw(write73(tmp_path / "73.mat", run))
        assert found.values.keys() == wanted.values.keys()
        assert found.repairs == wanted.repairs
        for name, values in wanted.values.items():
            np.testing.assert_array_equal(found[name], values)
        np.testing.assert_allclose(read(tmp_path / "73.mat")["command"], LOG["command"])
    square = write73(tmp_path / "square.mat", {"t": np.arange(3.0), "q": np.arange(9.0).reshape(3, 3)})
    np.testing.assert_array_equal(read_raw(square)["q_2"][:, 0], [1.0, 4.0, 7.0])


def test_what_is_no_number_in_version_73_is_left_out(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    path = write73(tmp_path / "run.mat", {"t": LOG.t, "q": LOG["q"], "more": {"tau": LOG["command"]}})
    marks = {"text": ("char", {}), "none": ("double", {"MATLAB_empty": 1})}
    marks["object"] = ("uint32", {"MATLAB_object_decode": 3})
    with h5py.File(path, "r+") as file:
        for name, (kind, attributes) in marks.items():
            file[name] = np.full((1, ROWS), 65, dtype="u4")
            file[name].attrs.update({"MATLAB_class": np.bytes_(kind), **attributes})
        file["roots"] = np.zeros((1, ROWS), dtype=[("real", "f8"), ("imag", "f8")])
        file["cells"] = np.full((1, ROWS), file["t"].ref, dtype=h5py.ref_dtype)
        file["#refs#/a"] = np.zeros((1, ROWS))
        file["sparse/ir"] = np.zeros((1, ROWS))
        file["sparse"].attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": ROWS})
        file["circle/again"] = file["/"]
        file["away"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "t")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["t"] = np.zeros((1, ROWS))
    assert set(read_raw(path).values) == {"t", *(f"{w}_{i}" for w in ("q", "more.tau") for i in (1, 2, 3))}
    with h5py.File(path, "r+") as file:
        shape = {"shape": (1, ROWS), "dtype": "f8", "external": [(str(tmp_path / "raw"), 0, 8 * ROWS)]}
        file.create_dataset("raw", **shape)
    with pytest.raises(DataError, match="of a variable are in another file"):
        read_raw(path)


def test_a_cut_file_of_version_73(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="version 7.3 is read by the extra 'matlab'")
    path = write73(tmp_path / "run.mat", {"t": LOG.t, "q": LOG["q"], "tau": LOG["command"]})
    whole = path.read_bytes()
    for size in (512, len(whole) // 2, len(whole) - 100):
        path.write_bytes(whole[:size])
        with pytest.raises(DataError, match=r"cannot be read as MAT.*It is truncated"):
            read(path)


def test_version_73_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512))
    with pytest.raises(UsageError, match=r"version 7\.3 needs h5py") as problem:
        read(tmp_path / "run.mat")
    assert problem.value.next_step == (
        "Install it: pip install 'h5py>=3.10', or save it in MATLAB with save(name, '-v7')"
    )


def test_what_cannot_be_read_of_matlab(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    path.write_bytes(b"no mat file at all".ljust(512))
    with pytest.raises(DataError, match="cannot be read as MAT"):
        read(path)
    savemat(path, {"gain": 1.0, "name": "ur10"})
    with pytest.raises(DataError, match="no variable with more than one number"):
        read(path)


def test_a_damaged_type_is_refused_where_scipys_reader_ends_the_program(tmp_path: Path) -> None:
    """The reason for a reader of our own: docs/decisions/0055-matlab-files.md."""
    path = tmp_path / "run.mat"
    savemat(path, {"t": LOG.t, "q": LOG["q"]})
    data = path.read_bytes()
    tag = np.array([9, 8 * ROWS], dtype="<u4").tobytes()  # doubles, and their bytes; 10 is no type
    assert tag in data
    path.write_bytes(data.replace(tag, b"\x0a" + tag[1:], 1))
    with pytest.raises(DataError, match="cannot be read as MAT"):
        read(path)
    alone = "import sys, scipy.io\ntry: scipy.io.loadmat(sys.argv[1])\nexcept BaseException: pass"
    done = subprocess.run([sys.executable, "-c", alone, str(path)], capture_output=True, check=False)
    assert done.returncode != 0, "SciPy refuses it: look at the record again"


def dataset(folder: Path, names: object, episodes: int = 1) -> Path:
    """A dataset by the documented layout of version 3, with efforts."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    features = {
        f: {"dtype": "float32", "shape": [3], "names": names} for f in ("observation.state", "action")
    }
    features["observation.effort"] = features["observation.state"]
    info = {"codebase_version": "v3.0", "fps": 100, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    frame = pl.DataFrame(
        {
            "observation.state": LOG["q"].tolist(),
            "observation.effort": LOG["command"].tolist(),
            "action": (LOG["q"] + 0.01).tolist(),
            "timestamp": LOG.t,
        }
    )
    frames = [frame.with_columns(pl.lit(e).alias("episode_index")) for e in range(episodes)]
    pl.concat(frames).write_parquet(folder / "data" / "chunk-000" / "file-000.parquet")
    return folder


@pytest.mark.parametrize(
    "names", [list(JOINTS), [list(JOINTS)], {"motors": [f"{j}.pos" for j in JOINTS]}, None]
)
def test_a_lerobot_dataset(names: object, tmp_path: Path) -> None:
    folder = dataset(tmp_path / "data set", names)
    for path in (folder, folder / "data" / "chunk-000" / "file-000.parquet"):
        log = read(path)
        np.testing.assert_array_equal(log["q"], LOG["q"])
        np.testing.assert_array_equal(log["command"], LOG["command"])
        np.testing.assert_allclose(log["q_des"], LOG["q"] + 0.01)


def test_a_list_of_names_within_a_list_names_the_joints(tmp_path: Path) -> None:
    raw = read_raw(dataset(tmp_path / "set", [[f"k{j}" for j in JOINTS]]))
    assert f"position/k{JOINTS[0]}" in raw.values


def test_names_that_are_too_few_are_told(tmp_path: Path) -> None:
    raw = read_raw(dataset(tmp_path / "set", list(JOINTS[:-1])))
    assert "position/0" in raw.values
    told = [said for said in raw.repairs if said.startswith("meta/info.json names")]
    assert "2 of the 3 entries of observation.state" in told[0]


def test_a_pointer_of_git_lfs_is_named(tmp_path: Path) -> None:
    """In a dataset and alone, whatever its suffix."""
    folder = dataset(tmp_path / "set", list(JOINTS))
    inside = folder / "data" / "chunk-000" / "file-000.parquet"
    for path in (inside, tmp_path / "run.mcap", tmp_path / "run.csv", tmp_path / "run.xyz"):
        path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:3dac\nsize 16336096\n")
        with pytest.raises(DataError, match="pointer of Git LFS") as problem:
            read(path)
        assert "git lfs pull" in problem.value.next_step
    with pytest.raises(DataError, match="pointer of Git LFS"):
        read(folder)


def test_an_episode_is_a_log(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "set", list(JOINTS), episodes=3)
    with pytest.raises(DataError, match=r"3 episodes.*--topic episode_0.*episode_2"):
        read(folder)
    assert len(read(folder, "episode_2")) == ROWS
    for wrong in ("episode_3", "two"):
        with pytest.raises(DataError, match=f"no episode {wrong}"):
            read(folder, wrong)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"features": 3}', '{"features": {"action": 3}}'])
def test_a_broken_description_is_named(content: str, tmp_path: Path) -> None:
    folder = dataset(tmp_path / "set", list(JOINTS))
    (folder / "meta" / "info.json").write_text(content)
    with pytest.raises(DataError, match="description cannot be read"):
        read(folder)
