"""Models on disk: the same predictions, without MuJoCo, and clear words about damage."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from etude.models.inverse_dynamics import train_model
from etude.models.model_file import load_model, save_model
from learning_examples import SMALL, pendulum, trajectories, trajectory

from etude.errors import DataError


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    spec = pendulum(tmp_path_factory.mktemp("robot"))
    data = trajectories(2)
    kinds = ("gp", "identified", "identified+gp")
    configs = {kind: replace(SMALL, kind=kind) for kind in kinds}
    configs["thesis"] = replace(SMALL, kernel="ard_se", friction_fraction=0.0, noise_floor=0.0)
    return {name: train_model(data, spec, c, np.random.default_rng(0)) for name, c in configs.items()}


@pytest.mark.parametrize("kind", ["gp", "identified", "identified+gp", "thesis"])
def test_a_loaded_model_predicts_the_same(kind, models, tmp_path) -> None:
    model, new = models[kind], trajectory(5)
    save_model(model, tmp_path)
    loaded = load_model(tmp_path)
    for first, second in zip(
        loaded.predict(new.q, new.qd, new.qdd), model.predict(new.q, new.qd, new.qdd), strict=True
    ):
        np.testing.assert_allclose(first, second, rtol=1e-12)
    assert loaded.kind == model.kind
    assert (loaded.fallback is None) == (model.fallback is None)
    for name in ("offset", "scale", "prior_deviation", "stick_velocity"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))


def test_saving_twice_writes_the_same_model(models, tmp_path) -> None:
    save_model(models["identified+gp"], tmp_path / "a")
    save_model(load_model(tmp_path / "a"), tmp_path / "b")
    assert (tmp_path / "a/model.json").read_bytes() == (tmp_path / "b/model.json").read_bytes()
    first, second = (np.load(tmp_path / part / "model.npz") for part in "ab")
    assert set(first) == set(second)
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])


def test_a_rigid_mean_is_evaluated_without_mujoco(models, tmp_path) -> None:
    save_model(models["identified+gp"], tmp_path)
    code = (
        "import sys, numpy as np\n"
        "from etude.models.model_file import load_model\n"
        "x = np.full((3, 2), 0.1)\n"
        "print(load_model(sys.argv[1]).predict(x, x, x)[0].shape)\n"
        "assert not {'mujoco', 'numba', 'plotly'} & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(3, 2)"


def test_damage_is_named_and_nothing_is_half_read(models, tmp_path) -> None:
    with pytest.raises(DataError, match="no model that can be read"):
        load_model(tmp_path)
    save_model(models["gp"], tmp_path)
    words = tmp_path / "model.json"
    good = words.read_text()
    words.write_text(json.dumps(json.loads(good) | {"version": 99}))
    with pytest.raises(DataError, match="version 99"):
        load_model(tmp_path)
    words.write_text(good)
    numbers = tmp_path / "model.npz"
    whole = numbers.read_bytes()
    for part in (b"", whole[: len(whole) // 2], b"not a zip file"):
        numbers.write_bytes(part)
        with pytest.raises(DataError, match="no model that can be read"):
            load_model(tmp_path)
