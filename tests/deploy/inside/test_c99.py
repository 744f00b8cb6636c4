"""The model in C agrees with Python for every member, compiler and type, and keeps its head."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_models import ARM, QUADROTOR, alone, arm_model, arm_spec, averaged, quadrotor_model, quadrotor_spec

from compilers import FAST, SANITIZED, STRICT, run, tool
from etude.deploy import CForm, c_files, log_of, planned
from etude.deploy.targets.c99.self_test import golden_vectors
from etude.models import LearnedModel

WAVES = 12
"""Sines and cosines of a joint's position in physics with ripple."""
WHOLE = CForm(variance=True, digest="0" * 64)


@dataclass(frozen=True)
class Case:
    """A model, and its robot."""

    make: Any
    kind: Any = ARM
    spec: Any = None

    def files(self, form: CForm, name: str) -> Any:
        spec = self.spec() if self.spec else arm_spec()
        return c_files(self.make(), self.kind, spec, form, name)


def default() -> LearnedModel:
    """As `tell` leaves it: physics with ripple, the structured kernel, what friction remembers, averaged."""
    first = rippled(arm_model("exact", "structured", physics=True, memory=True))
    return averaged(first, arm_model("exact", "standing", physics=True, memory=True), least=True)


def rippled(model: LearnedModel) -> LearnedModel:
    """Its physics with waves of each joint's position."""
    found = []
    for candidate in model.candidates:
        mean: Any = candidate.mean
        size = 0.02 * np.asarray(ARM.limit(arm_spec()))[:, None]
        ripple = size * np.random.default_rng(3).normal(size=(len(size), WAVES))
        found.append(replace(candidate, mean=replace(mean, model=replace(mean.model, ripple=ripple))))
    return replace(model, candidates=tuple(found))


def lagrangian() -> LearnedModel:
    own, every = arm_model("exact", "gip_lin"), arm_model("all_lin", "ard_se", together=True)
    return averaged(arm_model("exact", "structured"), own, every)


CASES = {
    "structured": Case(default),
    "exact_shared": Case(lambda: arm_model("exact", "short", together=True)),
    "dictionary": Case(lambda: arm_model("dictionary_variance", "structured")),
    "ssgp_fixed": Case(lambda: arm_model("ssgp_fixed", "ard_se")),
    "ssgp_learned": Case(lambda: arm_model("ssgp_learned", "ard_se")),
    "fitc": Case(lambda: arm_model("fitc", "structured")),
    "vfe": Case(lambda: arm_model("vfe", "short")),
    "sogp": Case(lambda: arm_model("sogp", "short")),
    "lagrangian": Case(lagrangian),
    "identified": Case(lambda: alone(arm_model(physics=True), grows=False)),
    "doubted": Case(lambda: alone(arm_model(physics=True), grows=True)),
    "quadrotor": Case(lambda: quadrotor_model("quadrotor"), QUADROTOR, lambda: quadrotor_spec("quadrotor")),
    "pelican": Case(lambda: quadrotor_model("pelican"), QUADROTOR, lambda: quadrotor_spec("pelican")),
    "hexa": Case(lambda: quadrotor_model("hexa"), QUADROTOR, lambda: quadrotor_spec("hexa")),
    "octo": Case(lambda: quadrotor_model("octo"), QUADROTOR, lambda: quadrotor_spec("octo")),
    "mobile": Case(
        lambda: arm_model(physics=True, memory=True, spec=arm_spec("mobile_arm")),
        spec=lambda: arm_spec("mobile_arm"),
    ),
}
EVERYDAY = ("structured", "ssgp_fixed", "fitc", "hexa", "octo")


def written(folder: Path, name: str, form: CForm) -> Any:
    found = CASES[name].files(form, name)
    for file, data in found.files.items():
        (folder / file).write_bytes(data)
    return found


def agrees(folder: Path, name: str, compiler: str, flags: tuple[str, ...]) -> None:
    command = [tool(compiler), *STRICT, *flags, f"{name}.c", f"{name}_test.c", "-lm", "-o", f"{name}_run"]
    run(command, folder)
    said = run([f"./{name}_run"], folder)
    assert said.endswith("0 wrong flags\n"), said


@pytest.mark.parametrize("name", ["exact_shared", "fitc", "vfe", "sogp", "ssgp_fixed"])
def test_the_vectors_ask_the_process(name: str) -> None:
    """Far from all points a process says nothing, and its C could hold anything."""
    model = CASES[name].make()
    plan = planned(model, ARM, arm_spec(), name)
    silent = tuple(replace(c, units=c.units * np.array([[1.0], [0.0]])) for c in model.candidates)
    log = log_of(plan.channels, golden_vectors(plan).inputs, "golden")
    said = np.abs(model.predict(log)[0] - replace(model, candidates=silent).predict(log)[0]) / plan.limit
    assert (np.median(said, axis=0) > 1e-6).all()
    assert (said.max(axis=0) > 1e-3).all()


@pytest.mark.parametrize("name", ["structured", "mobile"])
def test_the_vectors_ask_what_physics_remembers(name: str) -> None:
    """Where friction turns by speed alone, or nothing turns round, its C could hold anything."""
    case = CASES[name]
    plan = planned(case.make(), case.kind, case.spec() if case.spec else arm_spec(), name)
    log = log_of(plan.channels, golden_vectors(plan).inputs, "golden")
    means = [c.mean for c in plan.candidates if c.mean is not None]
    said = [np.abs(m.predict(plan.model.inputs.followed(log)) - m.predict(log)) / plan.limit for m in means]
    assert plan.memory > 0
    assert plan.rate > 0.0
    assert max(float(s.max()) for s in said) > 0.01
    if name == "mobile":  # every drive is a joint's own
        ways = {way for m in means for way in m.model.way.tolist()}
        assert ways - {0.0}


@pytest.mark.parametrize("name", EVERYDAY)
def test_members_agree(name: str, tmp_path: Path) -> None:
    written(tmp_path, name, WHOLE)
    agrees(tmp_path, name, "gcc", ("-O0",))


@pytest.mark.slow
@pytest.mark.parametrize("single", [False, True], ids=["double", "float"])
@pytest.mark.parametrize("name", CASES)
def test_every_member_with_every_compiler(name: str, single: bool, tmp_path: Path) -> None:
    written(tmp_path, name, CForm(single, True, True, "0" * 64))
    for compiler in ("gcc", "clang"):
        for flags in (SANITIZED, ("-O2",), FAST):
            agrees(tmp_path, name, compiler, flags)
    written(tmp_path, name, CForm(single, fade=False))
    for compiler in ("gcc", "clang"):
        agrees(tmp_path, name, compiler, FAST)
