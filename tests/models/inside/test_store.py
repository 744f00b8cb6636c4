"""Models as one file: the same bits, shared arrays once, few imports, clear words about damage."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from learning_examples import PHYSICS, SMALL, TOGETHER, Inputs, selection, train, trajectories, trajectory

from etude.errors import DataError
from etude.models import LearnedModel, ModelConfig, load_model, save_model
from etude.models.config import STRUCTURES
from etude.models.store import WORDS, model_bytes

AUTO = replace(SMALL, rung="auto", student_t=True)


def loaded(path) -> LearnedModel:
    return load_model(path, Inputs().restore, PHYSICS)


def same(mine: LearnedModel, other: LearnedModel) -> None:
    new = trajectory(5).log
    for name in ("predict", "mean", "static", "safe"):
        for one, two in zip(
            np.atleast_1d(getattr(mine, name)(new)), np.atleast_1d(getattr(other, name)(new)), strict=True
        ):
            np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(mine.prior_deviation, other.prior_deviation)


@pytest.fixture(scope="module")
def full() -> LearnedModel:
    return selection(trajectories(2), AUTO).model


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("config", [SMALL, TOGETHER], ids=["separate", "together"])
def test_a_stored_model_predicts_the_same_bits(structure: str, config: ModelConfig, tmp_path) -> None:
    model = train(trajectories(2), replace(config, rung=structure, steps=4))
    save_model(tmp_path / "model.npz", model)
    same(loaded(tmp_path / "model.npz"), model)


def test_every_rung_comes_back_with_all_that_is_known(full, tmp_path) -> None:
    save_model(tmp_path / "model.npz", full)
    again = loaded(tmp_path / "model.npz")
    assert again.structures == full.structures
    assert again.chosen == full.chosen
    assert (again.commands, again.calibrated, again.student) == (full.commands, full.calibrated, full.student)
    assert (again.warnings, again.member) == (full.warnings, full.member)
    assert again.inputs == full.inputs
    np.testing.assert_array_equal(again.worth(), full.worth())
    np.testing.assert_array_equal(again.ranges, full.ranges)
    for structure in full.structures:
        same(again.of_structure(structure), full.of_structure(structure))
    assert [own for _, own in again.latents()] == [own for _, own in full.latents()]


def test_two_means_of_one_structure_stay_two(full, tmp_path) -> None:
    other = PHYSICS["identified"](trajectory(7))
    (last,) = [k for k, c in enumerate(full.candidates) if c.structure == "identified" and c.commands == (1,)]
    candidates = [replace(c, mean=other) if k == last else c for k, c in enumerate(full.candidates)]
    model = replace(full, candidates=tuple(candidates))
    save_model(tmp_path / "model.npz", model)
    again = loaded(tmp_path / "model.npz")
    same(again.of_structure("identified"), model.of_structure("identified"))
    assert len({id(c.mean) for c in again.candidates if c.structure.startswith("identified")}) == 2
    assert model_bytes(again) == model_bytes(model)


def test_storing_twice_gives_the_same_bytes_and_shared_arrays_are_there_once(full, tmp_path) -> None:
    data = model_bytes(full)
    save_model(tmp_path / "model.npz", full)
    assert model_bytes(loaded(tmp_path / "model.npz")) == data
    together = model_bytes(selection(trajectories(2), replace(TOGETHER, rung="auto")).model)
    with np.load(io.BytesIO(together)) as file:
        inputs = [name for name in file if file[name].shape == (SMALL.points, 8)]
        assert len(inputs) == 1  # two commands, two structures, two forms without a process: one X
    assert len(together) < len(data)


def test_training_goes_on_from_a_stored_model_as_from_the_one_in_memory(full, tmp_path) -> None:
    save_model(tmp_path / "model.npz", full)
    kept, stored = (
        selection(trajectories(3), AUTO, start).model for start in (full, loaded(tmp_path / "model.npz"))
    )
    same(stored, kept)


def test_a_model_is_evaluated_without_compilers_and_simulators(tmp_path) -> None:
    model = train(trajectories(2), replace(SMALL, process="dictionary_error", kernel="ard_se", steps=2))
    save_model(tmp_path / "model.npz", model)
    code = (
        "import sys, numpy as np\n"
        "from learning_examples import Inputs, PHYSICS, trajectory\n"
        "from etude.models.store import load_model\n"
        "model = load_model(sys.argv[1], Inputs().restore, PHYSICS)\n"
        "print(model.predict(trajectory(3).log)[0].shape)\n"
        "bad = {'mujoco', 'numba', 'polars', 'etude_sparse.dictionary', 'etude_sparse.sogp'}\n"
        "assert not bad & set(sys.modules), bad & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "model.npz")],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[1],
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(200, 2)"


def test_damage_is_named_and_nothing_is_half_read(full, tmp_path) -> None:
    path = tmp_path / "model.npz"
    with pytest.raises(DataError, match="not a readable model"):
        loaded(path)
    whole = model_bytes(full)
    for part in (b"", whole[:200], whole[: len(whole) // 2], whole[:-30], b"not a zip file"):
        path.write_bytes(part)
        with pytest.raises(DataError, match="not a readable model"):
            loaded(path)
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    path.write_bytes(bytes(flipped))
    with pytest.raises(DataError, match="not a readable model"):
        loaded(path)


@pytest.mark.parametrize(
    "change",
    [
        {"version": 99},
        {"member": None},
        {"arrays": {}},
        {"candidates": [{"rung": "gp"}]},
        {"commands": None},
    ],
)
def test_foreign_words_are_refused(change, full, tmp_path) -> None:
    with np.load(io.BytesIO(model_bytes(full))) as file:
        arrays = dict(file)
    words = json.loads(bytes(arrays[WORDS])) | change
    arrays[WORDS] = np.frombuffer(json.dumps(words).encode(), dtype=np.uint8)
    np.savez(tmp_path / "model.npz", **arrays)
    with pytest.raises(DataError, match="not a readable model"):
        loaded(tmp_path / "model.npz")


def test_a_mean_of_physics_that_the_robot_lacks_is_named(full, tmp_path) -> None:
    save_model(tmp_path / "model.npz", full)
    with pytest.raises(DataError, match="has no identified physics"):
        load_model(tmp_path / "model.npz", Inputs().restore, {})
