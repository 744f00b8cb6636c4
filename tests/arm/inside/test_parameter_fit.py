"""Base parameters and friction with intervals: what no motion shows, the terms that are there, the words."""

from __future__ import annotations

import csv
import ctypes
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loading_examples import ARM, BOX, link, write
from test_identified_files import FRICTION, NAMES, given, heavier, motion, spec_of, torques

from compilers import STRICT, run, tool
from etude import plugins
from etude.types import Log, Samples
from etude_arm import KIND, ArmPhysics, ArmSpec
from etude_arm.identified.combinations import combinations
from etude_arm.identified.parameter_fit import (
    TERMS,
    ParameterFit,
    Problem,
    parameter_fit,
    savage_dickey,
    settled,
)
from etude_arm.identified.parameter_report import friction_c
from etude_arm.physics.identification import since_reversal
from etude_arm.spec import COMMAND_RATES

PARAMETERS = plugins.load("etude.targets", "parameters")
Law = Callable[[np.ndarray, np.ndarray], np.ndarray]
V0 = 0.04
VISCOUS = np.array([0.5, 0.3, 0.1])


def usual(qd: np.ndarray, _: np.ndarray) -> np.ndarray:
    return FRICTION * np.tanh(qd / V0) + VISCOUS * qd


def samples_of(
    spec: ArmSpec, path: Path, law: Law, seed: int, memory: float = 0.6, rotor: float = 0.0
) -> Samples:
    """Logs of the robot of `path`, with noise that remembers: of each sample a part of the one before."""
    rng = np.random.default_rng(seed)
    parts = [motion(rng, 300, spec.dof) for _ in range(3)]
    q, qd, qdd = (2.0 * np.concatenate([part[i] for part in parts]) for i in range(3))
    rigid = torques(path, spec.names, q, qd, qdd)
    noise = 0.05 * rng.normal(size=q.shape)
    for k in range(1, len(noise)):
        noise[k] += memory * noise[k - 1]
    channels = {c.name: c for c in spec.channels()}
    values = {"q": q, "qd": qd, "qdd": qdd, "command": rigid + law(qd, rigid) + rotor * qdd + noise}
    log = Log(0.05 * np.arange(len(q)), {name: channels[name] for name in values}, values)
    return Samples(log, np.repeat(np.arange(3), 300), np.ones(q.shape, bool), np.abs(qd) > 0.02)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> tuple[ArmSpec, Path]:
    path = write(tmp_path_factory.mktemp("robot"))
    return spec_of(path), heavier(path, path.with_name("real.urdf"))


def fitted(robot: tuple[ArmSpec, Path], law: Law = usual, seed: int = 0) -> ParameterFit:
    spec, real = robot
    samples = samples_of(spec, real, law, seed)
    return parameter_fit(settled(samples, spec, ArmPhysics(spec)(samples)))


@pytest.fixture(scope="module")
def fit(robot: tuple[ArmSpec, Path]) -> ParameterFit:
    return fitted(robot)


def test_base_parameters_say_all_that_motion_shows(fit: ParameterFit) -> None:
    bases, silent = combinations(fit)
    weights = np.array([one.row(len(fit.theta)) for one in bases])
    assert np.linalg.matrix_rank(fit.shown * fit.scale) == len(bases)
    # commands are a function of the base parameters: each pivot's column times its value
    pivots = [one.parts[0][0] for one in bases]
    commands = fit.shown[:, pivots] @ (weights @ fit.theta)
    np.testing.assert_allclose(commands, fit.shown @ fit.theta, atol=1e-6 * np.abs(commands).max())
    np.testing.assert_allclose(fit.shown[:, silent], 0.0, atol=1e-9)
    assert all(one.parts[0][1] == 1.0 for one in bases)


@pytest.mark.slow
def test_intervals_hold_the_truth(robot: tuple[ArmSpec, Path]) -> None:
    spec, real = robot
    z = []
    for seed in range(5):
        fit = fitted(robot, seed=seed)
        weights = np.array([one.row(len(fit.theta)) for one in combinations(fit)[0]])
        tree = ArmPhysics(replace(spec, model_file=real)).geometry.tree
        truth = np.append(tree.nominal[1:].reshape(-1), np.zeros(spec.dof))
        deviation = np.sqrt(np.einsum("kp,pq,kq->k", weights, fit.after, weights))
        own = (fit.friction.terms[:, 1:3] - np.transpose([VISCOUS, FRICTION])) / fit.friction.deviation[
            :, 1:3
        ]
        z.append(np.concatenate([weights @ (fit.theta - truth) / deviation, own.ravel()]))
    inside = np.mean(np.abs(z) < 1.96)
    assert 0.88 <= inside <= 1.0
    assert 0.5 < np.std(z) < 1.4, "neither far too wide nor far too narrow"


LATE = 0.008
"""s from a command to its effect."""


def late_samples(spec: ArmSpec, path: Path, seed: int) -> Samples:
    """Logs whose commands act later, with the rate that a filter would give."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(300)
    w = 0.7 * np.arange(1, 5)[:, None]
    parts = [(rng.uniform(0.1, 0.5, (4, spec.dof)), rng.uniform(0.0, 6.3, (4, spec.dof))) for _ in range(3)]

    def moved(at: np.ndarray) -> list[np.ndarray]:
        found = []
        for size, phase in parts:
            angle = at[:, None, None] * w + phase
            waves = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
            found.append([(size * wave).sum(axis=1) for wave in waves])
        return [np.concatenate(one) for one in zip(*found, strict=True)]

    def force(at: np.ndarray) -> np.ndarray:
        q, qd, qdd = moved(at)
        rigid = torques(path, spec.names, q, qd, qdd)
        return rigid + usual(qd, rigid)

    q, qd, qdd = moved(t)
    before, now, after = (force(t + LATE + step) for step in (-0.005, 0.0, 0.005))
    rates = (after - before) / 0.01, (after - 2.0 * now + before) / 0.005**2
    command = now + 0.05 * rng.normal(size=q.shape)
    channels = {c.name: c for c in spec.channels()}
    values = {"q": q, "qd": qd, "qdd": qdd, "command": command}
    for name, rate in zip(COMMAND_RATES, rates, strict=True):
        channels[name] = replace(channels["command"], name=name, role="aside")
        values[name] = rate
    log = Log(np.tile(t, 3), {name: channels[name] for name in values}, values)
    return Samples(log, np.repeat(np.arange(3), len(t)), np.ones(q.shape, bool), np.abs(qd) > 0.02)


def test_a_small_delay_is_told_from_friction(robot: tuple[ArmSpec, Path]) -> None:
    spec, real = robot
    samples = late_samples(spec, real, 0)
    apart = replace(samples, log=samples.log.without(*COMMAND_RATES))
    found, blind = (parameter_fit(settled(one, spec, ArmPhysics(spec)(one))) for one in (samples, apart))
    late, deviation = found.delay
    assert abs(late - LATE) < 3.0 * deviation < 0.3 * LATE
    off = [(fit.friction.terms[:, 1] - VISCOUS) / fit.friction.deviation[:, 1] for fit in (found, blind)]
    assert np.abs(off[0]).max() < 3.0
    assert np.abs(off[1]).max() > 5.0
    assert blind.delay[0] == 0.0


@pytest.mark.slow
def test_intervals_hold_friction_that_turns_at_an_unknown_speed(robot: tuple[ArmSpec, Path]) -> None:
    """With v0 taken as known none of them did."""
    law = lambda qd, _: FRICTION * np.tanh(qd / (2.5 * V0)) + VISCOUS * qd  # noqa: E731
    inside = []
    for seed in range(4):
        own = fitted(robot, law, seed).friction
        z = (own.terms[:, 1:3] - np.transpose([VISCOUS, FRICTION])) / own.deviation[:, 1:3]
        inside.append(np.abs(z) < 1.96)
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize(
    ("term", "law"),
    [
        ("stribeck", lambda qd, _: usual(qd, _) + 1.2 * np.exp(-((qd / (4 * V0)) ** 2)) * np.tanh(qd / V0)),
        ("load", lambda qd, rigid: usual(qd, rigid) + 0.1 * np.abs(rigid) * np.tanh(qd / V0)),
        ("asymmetry", lambda qd, _: usual(qd, _) + 0.3 * np.abs(qd)),
    ],
)
def test_a_term_is_shown_where_it_is_there_alone(
    robot: tuple[ArmSpec, Path], fit: ParameterFit, term: str, law: Law
) -> None:
    k = TERMS.index(term)
    none = fit.friction
    assert (none.evidence[:2, k] < 3.0).all()
    assert (np.abs(none.terms[:2, k]) <= 2.0 * none.deviation[:2, k]).all(), (
        "zero, or an interval that has it"
    )
    found = fitted(robot, law)
    assert found.friction.evidence[0, k] > 10.0
    wanted = {"stribeck": 1.2, "load": 0.1, "asymmetry": 0.3}[term]
    assert found.friction.terms[0, k] == pytest.approx(wanted, abs=3.0 * found.friction.deviation[0, k])
    assert 0.0 < found.friction.deviation[0, k] < 0.5 * wanted


BAND, LOOSE = 0.5, 0.06


@pytest.mark.parametrize("unit", ["N m", pytest.param("pwm", marks=pytest.mark.slow)])
def test_a_dead_band_is_told_from_friction_where_gravity_turns(
    robot: tuple[ArmSpec, Path], fit: ParameterFit, unit: str
) -> None:
    """Not of the shoulder, which turns about the vertical."""
    k, level = TERMS.index("dead band"), TERMS.index("coulomb")
    assert (fit.friction.evidence[:, k] < 0.0).all()
    assert (fit.friction.terms[:, k] == 0.0).all()
    law = lambda qd, rigid: usual(qd, rigid) + BAND * np.sign(rigid + usual(qd, rigid))  # noqa: E731
    found = fitted((replace(robot[0], command_unit=unit), robot[1]), law).friction
    assert found.evidence[1, k] > 10.0
    for term, true in ((k, BAND), (level, FRICTION[1])):
        assert found.terms[1, term] == pytest.approx(true, abs=3.0 * found.deviation[1, term])
        assert 0.0 < found.deviation[1, term] < 0.1 * true


def test_a_command_within_the_dead_band_tells_nothing_of_its_joint(robot: tuple[ArmSpec, Path]) -> None:
    """However long it stays there; on either side its filter smears the jump."""
    spec, real = robot
    samples = samples_of(spec, real, usual, 0)
    problem = Problem.of(samples, spec, ArmPhysics(spec)(samples))
    command = np.full(samples.command.shape, 4.0 * BAND)
    stay = slice(120, 180)  # 3 s
    command[stay, 1] = 0.4 * BAND
    told = problem.pushed_by(command, 0.1 * np.ones(spec.dof), np.full(spec.dof, BAND))
    told = told.only(np.array([True, False]))
    assert not told.used[stay, 1].any()
    rest = np.ones(len(command), dtype=bool)
    rest[110:190] = False
    np.testing.assert_array_equal(told.used[rest], problem.used[rest])
    np.testing.assert_array_equal(told.used[:, 0], problem.used[:, 0])


@pytest.mark.slow
def test_backlash_is_told_where_gravity_turns(robot: tuple[ArmSpec, Path], fit: ParameterFit) -> None:
    """Of an encoder at the motor, which leads the link."""
    spec, real = robot
    k, band = TERMS.index("backlash"), TERMS.index("dead band")
    assert (fit.friction.terms[:, k] == 0.0).all()
    samples = samples_of(spec, real, usual, 0, memory=0.0)
    rigid = torques(real, spec.names, *(samples.log[name] for name in ("q", "qd", "qdd")))
    ahead = samples.log["q"] + 0.5 * LOOSE * np.sign(rigid) * (np.arange(spec.dof) == 1)
    loose = replace(samples, log=replace(samples.log, values={**samples.log.values, "q": ahead}))
    found = parameter_fit(settled(loose, spec, ArmPhysics(spec)(loose))).friction
    assert found.evidence[1, k] > 3.0
    assert found.evidence[1, band] < 3.0
    assert found.terms[1, k] == pytest.approx(LOOSE, abs=3.0 * found.deviation[1, k])
    assert found.deviation[1, k] < 0.5 * LOOSE


def test_no_drive_sticks_less_than_it_slides(robot: tuple[ArmSpec, Path], fit: ParameterFit) -> None:
    """A friction that rises with speed as no viscous one does: the dip would be below zero."""
    k, level = TERMS.index("stribeck"), TERMS.index("coulomb")
    found = fitted(
        robot, lambda qd, _: usual(qd, _) - 0.3 * np.exp(-((qd / (8 * V0)) ** 2)) * np.tanh(qd / V0)
    )
    assert (found.friction.terms[:, k] >= 0.0).all()
    assert found.friction.v0[0] > 1.2 * V0, "friction that turns more slowly explains it"
    wide = found.friction.deviation[0, level]
    assert abs(found.friction.terms[0, level] - FRICTION[0]) < 2.5 * wide < 0.5 * FRICTION[0]


def test_a_rotor_may_outweigh_its_link(tmp_path: Path) -> None:
    """As of a wrist: the link's own inertia bounds nothing."""
    text = ARM
    for name, mass in (("hand", 0.5), ("left", 0.1), ("right", 0.1)):
        light = re.sub(
            r'(i.[xyz])="([0-9.]+)"', lambda m: f'{m[1]}="{1e-3 * float(m[2])}"', link(name, 1e-4, BOX)
        )
        text = text.replace(link(name, mass, BOX), light)
    path = write(tmp_path, text)
    spec = spec_of(path)
    samples = samples_of(spec, path, usual, 0, rotor=0.3)
    found = parameter_fit(settled(samples, spec, ArmPhysics(spec)(samples)))
    value, deviation = found.friction.terms[-1, 0], found.friction.deviation[-1, 0]
    assert abs(value - 0.3) < 3.0 * deviation
    assert deviation < 0.02


def test_evidence_is_the_density_of_zero_before_and_after() -> None:
    before, after, value = 2.0, 0.1, 0.3
    density = [np.exp(-0.5 * (x / s) ** 2) / s for x, s in ((0.0, before), (value, after))]
    assert savage_dickey(np.array(value), np.array(after), np.array(before)) == pytest.approx(
        np.log(density[0] / density[1])
    )


def test_time_to_a_reversal_stays_within_a_group() -> None:
    t, group = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0, 0, 0, 1, 1])
    found = since_reversal(t, group, np.array([[1.0], [-1.0], [-1.0], [1.0], [1.0]]))
    np.testing.assert_allclose(found[:3, 0], [0.5, 0.5, 1.5])
    assert found[3:].min() > 1e5


def test_the_c_function_is_the_friction(
    robot: tuple[ArmSpec, Path], fit: ParameterFit, tmp_path: Path
) -> None:
    terms = fit.friction.terms.copy()
    terms[:, TERMS.index("dead band")] = 0.4
    text = friction_c(replace(fit.friction, terms=terms), robot[0])
    axes = (replace(robot[0].axes[0], unit="m"), *robot[0].axes[1:])
    other = friction_c(fit.friction, replace(robot[0], name="7 Ärm", axes=axes))
    assert "shoulder N, elbow N m" in other
    assert other.isascii()
    assert "void n_7__rm_friction(" in other
    assert len(text.splitlines()) <= 25
    (tmp_path / "f.c").write_text(text.replace("static void", "void"))
    run([tool("gcc"), *STRICT, "-shared", "-fPIC", "f.c", "-o", "f.so", "-lm"], tmp_path)
    qd, load, out = np.array([0.3, -0.7, 0.01]), np.array([5.0, -2.0, 1.0]), np.zeros(3)
    pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (qd, load, out)]
    ctypes.CDLL(str(tmp_path / "f.so")).arm_friction(*pointers)
    viscous, coulomb, stribeck, by_load, asymmetry = fit.friction.terms[:, 1:6].T
    dip = np.exp(-((qd / fit.friction.stribeck_speed) ** 2))
    level = coulomb + stribeck * dip + by_load * np.abs(load)
    wanted = viscous * qd + level * np.tanh(qd / fit.friction.v0) + asymmetry * np.abs(qd)
    np.testing.assert_allclose(out, wanted + 0.4 * np.sign(load + wanted), rtol=1e-12)


def test_the_tables_say_what_is_known(robot: tuple[ArmSpec, Path]) -> None:
    spec, real = robot
    samples = samples_of(spec, real, usual, 1)
    delivered = PARAMETERS(None, KIND, spec, {**given(samples), "logs": ()})
    rows = list(csv.DictReader(io.StringIO(delivered.files["parameters.csv"].decode())))
    known = {row["parameter"]: row["known"] for row in rows}
    assert set(known.values()) <= {"measured", "partly", "from the file", "not identifiable"}
    assert known["upper mass"] == "not identifiable"
    assert "measured" in known.values()
    for row in rows:
        assert (row["lower"] == "") == (row["known"] == "not identifiable")
        if row["lower"]:
            assert float(row["lower"]) < float(row["value"]) < float(row["upper"])
    friction = {(row["joint"], row["term"]): row for row in json.loads(delivered.files["friction.json"])}
    coulomb = friction[NAMES[0], "coulomb"]
    assert coulomb["lower"] < FRICTION[0] < coulomb["upper"]
    assert coulomb["shown"]
    assert friction[NAMES[0], "load"]["lower"] is None
    assert any("combinations" in sentence for sentence in delivered.notes)
    assert "measured" in delivered.files["README.md"].decode()


def test_without_forces_there_is_friction_alone(robot: tuple[ArmSpec, Path]) -> None:
    spec = replace(robot[0], command_unit="V")
    samples = samples_of(spec, robot[1], usual, 2)
    delivered = PARAMETERS(None, KIND, spec, {**given(samples), "logs": ()})
    assert "parameters.csv" not in delivered.files
    assert any("masses need the motors' constants" in sentence for sentence in delivered.notes)
    friction = {(row["joint"], row["term"]): row for row in json.loads(delivered.files["friction.json"])}
    assert friction[NAMES[0], "coulomb"]["unit"] == "V"
    assert friction[NAMES[0], "coulomb"]["value"] == pytest.approx(FRICTION[0], rel=0.1)


def test_without_a_model_file_there_is_friction_that_masses_would_not_change(
    robot: tuple[ArmSpec, Path],
) -> None:
    spec = replace(robot[0], model_file=None)
    samples = samples_of(robot[0], robot[1], usual, 2)
    samples = samples.take(slice(None, None, len(samples) // 250))
    delivered = PARAMETERS(None, KIND, spec, {**given(samples), "logs": ()})
    assert "parameters.csv" not in delivered.files
    assert "only friction is identified" in delivered.notes[0]
    rows = {(row["joint"], row["term"]): row for row in delivered.facts["friction"]}
    for name, level in zip(NAMES, FRICTION, strict=True):
        coulomb = rows[name, "coulomb"]
        assert coulomb["value"] == pytest.approx(level, rel=0.1)
        assert coulomb["lower"] < coulomb["value"] < coulomb["upper"]
        assert coulomb["shown"]
        assert rows[name, "load"]["lower"] is None
    assert b"_friction(" in delivered.files["friction.h"]
    apart = replace(samples, group=np.arange(len(samples)))
    one_way = PARAMETERS(None, KIND, spec, {**given(apart), "logs": ()})
    assert one_way.notes[1].startswith(f"No interval is stated for {', '.join(NAMES)}: ")
    assert all(row["lower"] is None for row in one_way.facts["friction"])
    still = replace(samples, moving=np.zeros_like(samples.moving))
    rest = PARAMETERS(None, KIND, spec, {**given(still), "logs": ()})
    assert all("the logs show no term" in sentence for sentence in rest.notes[1:])
