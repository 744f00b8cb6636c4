"""Figures on real recordings: the split is honest, figures are those defined, bad files are refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from etude.cli import main
from etude.errors import DataError, UsageError
from etude.models import ModelConfig, ModelSelection, figures, split_blocks
from etude.types import Samples
from etude_studies import real_accuracy, real_logs
from etude_studies.external_logs import panda_log, sarcos_samples
from etude_studies.real_accuracy import accuracy_rows, real_rows
from etude_studies.real_logs import REAL_LOGS, Recording
from etude_studies.world import World


@pytest.fixture(scope="module")
def tx40() -> Recording:
    (log,) = (log for log in REAL_LOGS if log.name == "tx40")
    path = log.find()
    assert path is not None
    return log.load(path)


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings that take no time; what the whole ones are worth is measured by the bench."""
    learned = World.learned

    def few_steps(
        self: World, samples: Samples, model: ModelConfig, *more: Any, **how: Any
    ) -> ModelSelection:
        short = replace(model, steps=8, fit_points=100, points=200, candidates=("default",))
        return learned(self, samples, short, *more, **how)

    monkeypatch.setattr(World, "learned", few_steps)


def sarcos_like(n: int = 400) -> dict[str, np.ndarray]:
    """A smooth motion of seven joints and commands that are linear in it, so linear regression is perfect."""
    t = 0.1 * np.arange(n)[:, None]
    speed, phase = np.linspace(0.3, 0.9, 7), np.linspace(0.0, 2.0, 7)
    q, qd, qdd = np.sin(speed * t + phase), speed * np.cos(speed * t + phase), -(speed**2)
    qdd = qdd * np.sin(speed * t + phase)
    tau = 8.0 * q + 2.0 * qd + 0.3 * np.random.default_rng(0).normal(size=q.shape)
    return {"q": q, "qd": qd, "qdd": qdd, "tau": tau}


def test_every_recording_has_a_licence_and_only_permissive_ones_are_bundled() -> None:
    assert len({log.name for log in REAL_LOGS}) == len(REAL_LOGS)
    for log in REAL_LOGS:
        assert log.licence
        assert log.bundled == (log.licence in ("BSD-3-Clause", "Apache-2.0", "MIT"))
        assert (log.find() is not None) == log.bundled
    assert "decimated by ten" in next(log.note for log in REAL_LOGS if log.name == "sarcos")


def test_no_training_sample_is_within_the_filters_length_of_a_test_sample(tx40: Recording) -> None:
    apart = np.abs(tx40.train.t[:, None] - tx40.test.t)
    assert apart.min() >= 0.03 - 1e-9  # one period of the cutoff, 33 Hz
    ur10 = REAL_LOGS[0].load(real_logs.EXAMPLES / "ur10" / "ur10_exciting.csv")  # cutoff 7.3 Hz, samples 8 Hz
    assert np.abs(ur10.train.t[:, None] - ur10.test.t).min() >= 1.0 / 7.4
    assert len(np.flatnonzero(np.diff(tx40.test.t) > 0.5)) == 3  # four blocks
    share = len(tx40.test) / (len(tx40.test) + len(tx40.train))
    assert 0.18 < share < 0.26


def test_what_is_measured_in_a_test_block_does_not_reach_the_training_samples() -> None:
    """A disturbance of the command in the middle of a test block, filtered as always."""
    folder = real_logs.EXAMPLES / "tx40"
    world = World.of(folder / "tx40.toml")
    log = world.read(folder / "tx40_exciting.csv")
    whole = real_logs.recording(log, world)
    blow = log["command"].copy()
    blow[(log.t > 1.5) & (log.t < 1.6)] += 20.0
    hit = real_logs.recording(log.put(log.channels["command"], blow), world)
    assert np.abs(hit.test.command - whole.test.command).max() > 10.0
    # N m, of 20: what the filter's tail carries
    assert np.abs(hit.train.command - whole.train.command).max() < 0.3
    np.testing.assert_array_equal(hit.train.log["q"], whole.train.log["q"])


def test_raw_commands_are_those_recorded(tx40: Recording) -> None:
    assert tx40.raw is not None
    values = np.loadtxt(real_logs.EXAMPLES / "tx40" / "tx40_exciting.csv", delimiter=",", skiprows=1)
    nearest = np.array([np.argmin(np.abs(values[:, 0] - values[0, 0] - t)) for t in tx40.test.t])
    np.testing.assert_allclose(tx40.raw, values[nearest][:, 7:], atol=1e-6)


def test_a_gap_takes_samples_from_the_training_alone(tx40: Recording) -> None:
    data = tx40.train
    without, held = split_blocks(data)
    with_gap, same = split_blocks(data, gap_s=0.2)
    np.testing.assert_array_equal(held.t, same.t)
    assert set(with_gap.t) < set(without.t)
    lost = np.array(sorted(set(without.t) - set(with_gap.t)))
    assert np.abs(lost[:, None] - held.t).min(axis=1).max() < 0.2


def test_rows_are_the_defined_figures() -> None:
    rng = np.random.default_rng(0)
    tau = rng.normal(size=(300, 2))
    mean, linear, raw = (tau + size * rng.normal(size=tau.shape) for size in (0.1, 0.3, 0.2))
    moving = rng.uniform(size=tau.shape) < 0.8
    nmse, noisy, worst = accuracy_rows("log", tau, mean, linear, moving, raw)
    mine, theirs = (figures(tau, p, None, moving).nmse for p in (mean, linear))
    assert [r.metric for r in (nmse, noisy, worst)] == [
        "nmse_log",
        "nmse_log_raw",
        "nmse_log_worst_vs_linear",
    ]
    assert nmse.value == pytest.approx(mine.mean())
    assert nmse.reference_value == pytest.approx(theirs.mean())
    assert noisy.value == pytest.approx(figures(raw, mean, None, moving).nmse.mean())
    assert worst.value == pytest.approx((mine / theirs).max())


@pytest.mark.usefixtures("brief")
def test_a_folder_with_sarcos_is_measured_and_what_must_be_said_is(tmp_path, monkeypatch, capsys) -> None:
    np.savez(tmp_path / "sarcos_inv_test.npz", **sarcos_like())
    monkeypatch.setattr(real_logs, "EXAMPLES", tmp_path)
    rows = {row.metric: row for row in real_rows(np.random.default_rng(0), logs=tmp_path)}
    assert {"nmse_sarcos", "nmse_sarcos_all", "nmse_sarcos_worst_vs_linear"} == set(rows)
    assert rows["nmse_sarcos"].value < 0.02
    assert "decimated by ten" in " ".join(capsys.readouterr().err.split())


def test_an_empty_folder_is_refused_and_a_bench_without_recordings_takes_none(tmp_path, capsys) -> None:
    with pytest.raises(UsageError, match="none of the recordings"):
        real_rows(np.random.default_rng(0), logs=tmp_path)
    assert main(["bench", "gp", "--logs", str(tmp_path)]) == 2
    assert "does not take --logs" in capsys.readouterr().err


def test_the_original_matlab_file_is_the_same(tmp_path) -> None:
    from scipy.io import savemat

    arrays = sarcos_like()
    np.savez(tmp_path / "sarcos_inv_test.npz", **arrays)
    savemat(tmp_path / "sarcos_inv_test.mat", {"sarcos_inv_test": np.hstack(list(arrays.values()))})
    (_, one), (_, other) = (sarcos_samples(tmp_path / f"sarcos_inv_test.{kind}") for kind in ("npz", "mat"))
    for name in ("q", "qd", "qdd", "command"):
        np.testing.assert_array_equal(one.log[name], other.log[name])
    np.testing.assert_array_equal(one.moving, other.moving)
    (tmp_path / "sarcos_inv_test.mat").write_bytes(b"MATLAB 5.0, not")
    with pytest.raises(DataError, match="cannot be read"):
        sarcos_samples(tmp_path / "sarcos_inv_test.mat")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.pop("tau"), "no array tau"),
        (lambda a: a.update(q=a["q"][:, :6]), "not numbers of shape"),
        (lambda a: a.update(qd=a["qd"][:-5]), "not numbers of shape"),
        (lambda a: a["qdd"].__setitem__((3, 2), np.nan), "entries that are no numbers"),
    ],
    ids=["missing", "joints", "truncated", "nan"],
)
def test_damaged_arrays_are_refused(change, message: str, tmp_path) -> None:
    arrays = sarcos_like(60)
    change(arrays)
    np.savez(tmp_path / "sarcos_inv_test.npz", **arrays)
    with pytest.raises(DataError, match=message):
        sarcos_samples(tmp_path / "sarcos_inv_test.npz")


def test_a_panda_log_is_read_and_damaged_ones_refused(tmp_path) -> None:
    arrays = sarcos_like(200)
    path = tmp_path / "panda_exciting.npz"
    t = 0.1 * np.arange(200)
    np.savez(path, t=t, q=arrays["q"], qd=arrays["qd"], tau=arrays["tau"])
    log, world = panda_log(path)
    assert log["q"].shape == (200, 7)
    assert world.spec.rate == pytest.approx(10.0)
    np.savez(path, t=t[::-1], q=arrays["q"], qd=arrays["qd"], tau=arrays["tau"])
    with pytest.raises(DataError, match="time does not increase"):
        panda_log(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(DataError, match="cannot be read"):
        panda_log(path)


@pytest.mark.usefixtures("brief")
def test_outputs_that_linear_regression_predicts_better_are_said(monkeypatch, capsys, tx40) -> None:
    class Warned:
        def __init__(self, selection) -> None:
            self.model = replace(selection.model, warnings=("joint_1: a line is better.",))

    learned = World.learned
    monkeypatch.setattr(World, "learned", lambda *a, **options: Warned(learned(*a, **options)))
    real_accuracy.recording_rows("tx40", tx40, np.random.default_rng(0))
    assert "tx40, joint_1: a line is better." in capsys.readouterr().err
