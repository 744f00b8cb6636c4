"""The graph says what Python says, wherever it can be said at all; what cannot is named."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from c_models import (
    ARM,
    QUADROTOR,
    alone,
    arm_log,
    arm_model,
    arm_spec,
    averaged,
    quadrotor_model,
    quadrotor_spec,
)

from etude.deploy import CForm, c_files, graph_inputs, parts_of, written
from etude.deploy.targets.onnx import target
from etude.deploy.targets.onnx.target import ONNX, run_rows
from etude.errors import EtudeError, UsageError
from etude.models import (
    LearnedModel,
    LinearPhysics,
    PluginKernel,
    Posteriors,
    SquaredExponential,
    followed,
    posterior_given,
)
from etude.types import Array, Log

for library in ("onnx", "onnxruntime"):
    pytest.importorskip(library, reason="graphs are written and run by the extra 'onnx'")
LIMIT = np.asarray(ARM.limit(arm_spec()))


def mixed() -> LearnedModel:
    """Kernels that ignore what remembers, averaged with others, doubted, beside linear regression."""
    first = arm_model("exact", "structured", memory=True)
    line = LinearPhysics(first.inputs)
    log = arm_log(arm_spec(), 48)
    mean = line.restore({"weights": fitted(first, log)})
    sparse = arm_model("fitc", "structured", memory=True)
    rest = replace(
        sparse, candidates=tuple(replace(c, mean=mean, structure="linear+gp") for c in sparse.candidates)
    )
    return averaged(first, rest, least=True)


def fitted(model: LearnedModel, log: Any) -> Array:
    from etude.models import linear_inputs

    X = linear_inputs(model.inputs, model.inputs.of_log(log))
    return np.asarray(np.linalg.lstsq(X, 0.2 * log["command"], rcond=None)[0])


CASES = {
    "mixed": mixed,
    "shared": lambda: arm_model("exact", "ard_se", together=True),
    "ssgp": lambda: arm_model("ssgp_fixed", "ard_se"),
    "doubted": lambda: alone(arm_model("exact", "structured"), grows=True),
    "silent": lambda: alone(arm_model("exact", "structured"), grows=False),
    "dictionary": lambda: arm_model("dictionary_variance", "structured"),
    "sogp": lambda: arm_model("sogp", "ard_se"),
    "standing": lambda: arm_model("exact", "standing", memory=True),
    "all of it": lambda: averaged(
        arm_model("exact", "standing", memory=True, physics=True),
        alone(arm_model("exact", "standing", memory=True, physics=True), grows=True),
    ),
}


def written_of(model: LearnedModel, dtype: Any, variance: bool = True) -> bytes:
    parts = parts_of(model)
    return written(parts, graph_inputs(parts, ARM.channels(arm_spec())).widths, dtype, variance)


def near(model: LearnedModel, dtype: Any, spec: Any = None) -> tuple[Log, Array]:
    """A run near the data, where a process has much to say, and its states."""
    log = arm_log(spec or arm_spec(), 48)
    rng = np.random.default_rng(4)
    spread = {
        name: (1.0 + 0.05 * rng.standard_normal(log[name].shape)) * log[name] for name in ("q", "qd", "qdd")
    }
    states = np.concatenate([*spread.values()], axis=1).astype(dtype)
    parts = np.split(states.astype(float), 3, axis=1)
    own = Log(log.t, {name: log.channels[name] for name in spread}, dict(zip(spread, parts, strict=True)))
    return followed(model.inputs, own), states


def agrees(model: LearnedModel, dtype: Any, small: float, spec: Any = None) -> None:
    spec = spec or arm_spec()
    log, states = near(model, dtype, spec)
    parts, limit = parts_of(model), np.asarray(ARM.limit(spec)).min()
    widths = graph_inputs(parts, ARM.channels(spec)).widths
    own = run_rows(written(parts, widths, dtype, variance=True), parts, states)
    command, variance = own["command"], own["variance"]
    mean, spread = model.predict(log)
    assert np.abs(command - mean).max() <= small * limit
    assert np.abs(variance - spread).max() <= small * limit**2
    one = run_rows(written(parts, widths, dtype, variance=False), parts, states[:1])
    assert np.abs(one["command"] - command[:1]).max() <= small * limit


@pytest.mark.parametrize("name", ["mixed", "ssgp", "standing"])
def test_the_graph_agrees(name: str) -> None:
    model = CASES[name]()
    assert np.ptp(model.predict(near(model, float)[0])[0], axis=0).min() > 0.05
    agrees(model, np.float64, 1e-9)


def posture(own: Any) -> PluginKernel:
    """A plug-in's kernel that is a sum of the family's parts, as in the docs."""
    return PluginKernel("my_kernels:posture", (), ("waist",), own)


def with_kernel(model: LearnedModel, wrap: Any) -> LearnedModel:
    """The same model, its exact processes with a plug-in's kernel."""
    changed = []
    for candidate in model.candidates:
        own = candidate.process.own[0]  # type: ignore[union-attr]
        exact = posterior_given(wrap(own.kernel), own.theta, own.noise_variance, own.X, own.y)
        changed.append(replace(candidate, process=Posteriors((exact,))))
    return replace(model, candidates=tuple(changed))


def test_a_plug_in_kernel_of_our_parts_is_written_as_these() -> None:
    model = arm_model("exact", "standing", memory=True, points=24)
    wrapped = with_kernel(model, posture)
    agrees(wrapped, np.float64, 1e-9)
    assert "arm.c" in c_files(wrapped, ARM, arm_spec(), CForm(variance=True), "arm").files


def test_another_plug_in_kernel_is_refused_with_a_step() -> None:
    class Foreign(SquaredExponential):
        """A kernel of somebody who wrote no operators."""

    model = with_kernel(arm_model("exact", "ard_se", points=12), lambda own: posture(Foreign(own.dims)))
    with pytest.raises(UsageError, match="kernel 'my_kernels:posture' cannot be exported to ONNX") as refused:
        parts_of(model)
    assert 'kernel = "structured"' in refused.value.next_step
    assert "--to c" not in refused.value.next_step


def test_a_variance_is_never_below_its_noise() -> None:
    """In float the prior less what data told comes out below zero where data leave no doubt."""
    model = arm_model("exact", "ard_se", points=24)
    first: Any = model.candidates[0].process
    own = first.own[0]
    sure = posterior_given(own.kernel, own.theta + 3.0, 1e-6, own.X, own.y)
    candidates = tuple(replace(c, process=Posteriors((sure,))) for c in model.candidates)
    states = own.X[:, :12].astype(np.float32)
    doubtless = replace(model, candidates=candidates)
    variance = run_rows(written_of(doubtless, np.float32), parts_of(doubtless), states)["variance"]
    noise = [c.calibration[0] * c.units[1, 0] ** 2 * 1e-6 for c in candidates]
    assert (variance >= np.array(noise) * (1.0 - 1e-5)).all()


@pytest.mark.slow
@pytest.mark.parametrize("real", [np.float64, np.float32], ids=["double", "float"])
@pytest.mark.parametrize("name", CASES)
def test_every_process_agrees(name: str, real: Any) -> None:
    agrees(CASES[name](), real, 1e-9 if real is np.float64 else 1e-4)


def test_the_file_says_what_it_takes_and_gives() -> None:
    import onnx

    model = arm_model("exact", "ard_se", points=12)
    found = ONNX(model, ARM, arm_spec(), {"model_hash": "ab" * 32, "name": "1 arm", "real": "float"})
    (data,) = found.files.values()
    read = onnx.load_from_string(data)
    words = {row.key: row.value for row in read.metadata_props}
    assert tuple(found.files) == ("n_1_arm.onnx",)
    assert words["model_sha256"] == "ab" * 32
    assert words["states"].split(", ")[4] == "qd_waist [rad/s]"
    assert words["commands"].startswith("waist [pwm], shoulder")
    assert [entry.version for entry in read.opset_import] == [17]
    assert found.facts["deviation"] <= 1e-4


@pytest.mark.thinned
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("fade", [True, "no"])
@pytest.mark.parametrize("variance", [False, "yes"])
def test_any_outputs_together_are_right(variance: bool | str, fade: bool | str, real: str) -> None:
    """Each by its name, whatever stands beside it, switches as Python or a command line gives them."""
    model = CASES["mixed"]()
    given = {"outside": "yes", "variance": variance, "fade": fade, "real": real}
    found = ONNX(model, ARM, arm_spec(), given)
    (data,) = found.files.values()
    log, states = near(model, np.float64 if real == "double" else np.float32)
    log, states = ahead(log, 12), states[:12]
    own = run_rows(data, parts_of(model), states)
    told = model.predict(log, fade=fade is True)
    assert list(own) == ["command", *["variance"] * bool(variance), "outside"]
    assert np.abs(own["command"] - told.mean).max() <= 1e-4 * LIMIT.min()
    assert (own["outside"] == model.outside(log)).all()
    assert ("Outside: " in " ".join(found.notes)) is (fade is True)


def ahead(log: Log, rows: int) -> Log:
    return Log(log.t[:rows], log.channels, {name: values[:rows] for name, values in log.values.items()})


def test_a_switch_that_is_none_is_named() -> None:
    model = arm_model("exact", "ard_se", points=12)
    with pytest.raises(UsageError, match="variance must be yes or no, not 'maybe'"):
        ONNX(model, ARM, arm_spec(), {"variance": "maybe"})


@pytest.mark.parametrize(
    ("real", "off", "words", "step"),
    [
        ("double", {np.float64: 1e-3}, "the exported graph differs from Python by 1.0e-03", "report it"),
        ("float", {np.float64: 1e-3, np.float32: 2e-3}, "the exported graph differs", "report it"),
        (
            "float",
            {np.float64: 1e-12, np.float32: 2e-3},
            "float is not accurate .* 2.0e-03 .* 1.0e-12",
            "--real double",
        ),
    ],
)
def test_advice_is_of_the_cause(
    monkeypatch: pytest.MonkeyPatch, real: str, off: dict[Any, float], words: str, step: str
) -> None:
    """Double is advised where it is right, and to nobody who has it; a wrong graph is a bug."""
    monkeypatch.setattr(target, "deviation", lambda *given, **_: off[given[4]])
    with pytest.raises(EtudeError, match=words) as problem:
        ONNX(arm_model("exact", "ard_se", points=12), ARM, arm_spec(), {"real": real})
    assert step in problem.value.next_step
    assert problem.value.exit_code == (2 if "--real" in step else 1)


def test_what_cannot_be_written_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    model = arm_model("exact", "ard_se", points=12, physics=True)
    bare = replace(model, candidates=tuple(replace(c, mean=object()) for c in model.candidates))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="the physics object cannot be exported to ONNX"):
        parts_of(bare)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(UsageError, match="needs onnx, which is not installed") as problem:
        written_of(arm_model("exact", "ard_se", points=12), np.float64)
    assert "pip install 'onnx>=1.16'" in problem.value.next_step


@pytest.mark.slow
def test_kernels_and_processes_that_cannot_be_written_are_named() -> None:
    for model, words in (
        (arm_model("exact", "gip_lin", points=12), "the kernel '.*'"),
        (arm_model("all_lin", "ard_se", points=12, together=True), "the process"),
        (arm_model("local_gp", "ard_se", points=24), "a process of the form|the process"),
        (arm_model("lwpr", "ard_se", points=24), "a process of the form|the process"),
    ):
        with pytest.raises(UsageError, match=f"({words}).* cannot be exported to ONNX"):
            parts_of(model)


@pytest.mark.parametrize(("robot", "memory"), [("arm4", False), ("arm4_rough", True), ("mobile_arm", True)])
def test_physics_agree(robot: str, memory: bool) -> None:
    """Linkages, hinges and slides; friction that turns with speed, at once, and over a way."""
    spec = arm_spec(robot)
    model = arm_model("exact", "short", points=36, physics=True, memory=memory, spec=spec)
    agrees(model, np.float64, 1e-9, spec)


@pytest.mark.parametrize("robot", ["quadrotor", "pelican", "hexa", "octo"])
def test_a_vehicle_agrees(robot: str) -> None:
    """Voltages by Euler's equation, and least squares where nobody described the motors."""
    spec = quadrotor_spec(robot)
    found = ONNX(quadrotor_model(robot, points=24, spec=spec), QUADROTOR, spec, {"variance": True})
    assert found.facts["deviation"] < 1e-11


def test_memory_is_carried_from_call_to_call() -> None:
    """There and back again: the way back needs another command than the way there."""
    model = arm_model("exact", "standing", memory=True, physics=True, points=36)
    found = ONNX(model, ARM, arm_spec(), {})
    (data,) = found.files.values()
    parts, low, high = parts_of(model), *model.ranges[:, :12]
    there = np.linspace(low, high, 12) * np.repeat([1.0, 0.0, 0.0], 4)
    states = np.concatenate([there, there[::-1]])
    command = run_rows(data, parts, states)["command"]
    assert parts.memory == 2 * 9
    assert np.abs(command[:12] - command[:11:-1])[1:-1].max() > 0.01 * LIMIT.min()
    assert "zeros at the start of a run" in " ".join(found.notes)
