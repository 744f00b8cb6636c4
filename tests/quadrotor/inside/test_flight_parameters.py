"""Physical constants from flights: found again with their intervals, and not told where flights cannot."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from c_models import quadrotor_spec

from etude import plugins
from etude.errors import UsageError
from etude.types import Array, Log
from etude_quadrotor import KIND
from etude_quadrotor.channels import (
    ALTITUDE,
    ANGULAR_ACCELERATION,
    BODY_ACCELERATION,
    BODY_VELOCITY,
    RATES,
    SPECIFIC_FORCE,
    command,
)
from etude_quadrotor.flight_parameters import contradiction

G = 9.81
TRUTH = {
    "thrust curve": 0.7,
    "motor time constant": 0.04,
    "centre of mass x": 0.006,
    "centre of mass y": -0.004,
    "rotor drag x": 0.4,
    "rotor drag y": 0.5,
    "body drag x": 0.05,
    "body drag y": 0.06,
}
HOVER = 0.55
"""Of full scale, of all motors alike."""


def spec_of(count: int, **more: Any) -> Any:
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    rotors = [(0.2 * float(np.cos(a)), 0.2 * float(np.sin(a)), (-1.0) ** i) for i, a in enumerate(angles)]
    own = replace(quadrotor_spec("octo"), name="own", rotors=tuple(rotors), **more)
    names = tuple(f"motor_{i + 1}" for i in range(count))
    return replace(own, command_names=names, command_lower=(0.0,) * count, command_upper=(1.0,) * count)


def flown(spec: Any, seed: int, *, seconds: float = 20.0, rate: float = 125.0, quick: float = 1.0) -> Log:
    """A flight whose motors move the body by the laws of the module's head, with noise of the sensors."""
    rng, count, step = np.random.default_rng(seed), len(spec.command_names), 1.0 / rate
    t = step * np.arange(round(seconds * rate))
    curve, lag = TRUTH["thrust curve"], TRUTH["motor time constant"]

    def waves(width: int, size: float) -> Array:
        pace, phase = rng.uniform(0.5, 3.0, (4, width)), rng.uniform(0.0, 6.28, (4, width))
        return size * np.sin(t[:, None, None] * pace + phase).sum(axis=1) / 2.0

    held = np.repeat(rng.standard_normal((len(t) // 10 + 1, 1)), 10, axis=0)[: len(t)]
    u = HOVER + quick * (waves(1, 0.05) + 0.02 * held) + waves(count, 0.02)
    w, now = np.zeros_like(u), u[0]
    for k in range(len(t)):
        w[k] = now
        now = now + (u[k] - now) * (1.0 - np.exp(-step / lag))
    thrust = curve * w**2 + (1.0 - curve) * w
    most = G / (count * (curve * HOVER**2 + (1.0 - curve) * HOVER))
    v, places = waves(3, 3.0), np.array(spec.rotors)[:, :2]
    arms = places - [TRUTH["centre of mass x"], TRUTH["centre of mass y"]]
    turning = np.column_stack([thrust @ arms[:, 1] / 0.1, -thrust @ arms[:, 0] / 0.1, waves(1, 0.1)])
    force = np.zeros((len(t), 3))
    for axis, name in enumerate("xy"):
        spin, speed = w.mean(axis=1) / HOVER, np.linalg.norm(v, axis=1)
        drag = TRUTH[f"rotor drag {name}"] * spin + TRUTH[f"body drag {name}"] * speed
        force[:, axis] = -drag * v[:, axis]
    force[:, 2] = most * thrust.sum(axis=1) - 0.1 * v[:, 2] * w.mean(axis=1)
    noise = 0.15 * rng.standard_normal(force.shape)
    curved = spec.thrust_curve * u**2 + (1.0 - spec.thrust_curve) * u
    log = Log(t, {}, {}, f"{seed}.csv").put(command(spec), curved)
    for channel, values in (
        (SPECIFIC_FORCE, force + noise),
        (RATES, np.zeros((len(t), 3))),
        (ANGULAR_ACCELERATION, turning),
        (BODY_VELOCITY, v),
        (BODY_ACCELERATION, force),
        (ALTITUDE, np.full((len(t), 1), 3.0)),
    ):
        log = log.put(channel, values)
    return log


def told(spec: Any, logs: list[Log]) -> dict[str, dict[str, Any]]:
    """The rows of parameters.json by name."""
    target = plugins.load("etude.targets", "parameters")
    found = target(None, KIND, spec, {"samples": None, "config": None, "logs": logs, "model_hash": ""})
    assert len(found.notes) == len(found.facts["parameters"])
    rows = json.loads(found.files["parameters.json"])
    assert found.files["parameters.csv"].decode().count("\n") == len(rows) + 1
    return {row["parameter"]: row for row in rows}


@pytest.mark.parametrize(("count", "flown_with"), [(4, 0.0), (6, 0.3), (8, 1.0)])
def test_constants_are_found_again_within_their_intervals(count: int, flown_with: float) -> None:
    spec = spec_of(count, thrust_curve=flown_with)
    rows = told(spec, [flown(spec, seed) for seed in range(3)])
    curve = TRUTH["thrust curve"]
    truth = {
        **TRUTH,
        "hover thrust": flown_with * HOVER**2 + (1.0 - flown_with) * HOVER,
        "hover thrust with that curve": curve * HOVER**2 + (1.0 - curve) * HOVER,
    }
    assert set(rows) == set(truth)
    for name, true in truth.items():
        own = rows[name]
        assert own["known"] == "measured", own
        half = 0.5 * (own["upper"] - own["lower"])
        assert abs(own["value"] - true) < 2.0 * half, (name, true, own)
        assert half < {"thrust curve": 0.05, "1/m": 0.02}.get(own["unit"], 0.2 * abs(true) + 1e-3), own
    assert rows["hover thrust"]["set"].startswith(f"MPC_THR_HOVER = {rows['hover thrust']['value']:.3f}")
    assert ("thrustBase" in rows["hover thrust"]["set"]) == (count == 4)
    assert rows["centre of mass x"]["set"].startswith("CA_ROTOR*_PX = CA_ROTOR*_PX -0.00")
    assert rows["centre of mass y"]["set"].startswith("CA_ROTOR*_PY = CA_ROTOR*_PY -0.00")


def test_hover_thrust_is_that_of_the_curve_that_can_be_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thrust that grows less than the command: PX4's curve is then 0, and hovering takes the command."""
    monkeypatch.setitem(TRUTH, "thrust curve", -0.15)
    spec = spec_of(4)
    rows = told(spec, [flown(spec, seed) for seed in range(2)])
    assert rows["thrust curve"]["set"] == "THR_MDL_FAC = 0.00"
    assert rows["hover thrust with that curve"]["value"] == pytest.approx(HOVER, rel=0.005)


def test_what_logs_contradict_each_other_in_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two long logs, of motors that lag otherwise: the interval of each alone excludes the other."""
    spec = spec_of(4)
    first = flown(spec, 0, seconds=40.0)
    alike = told(spec, [first, flown(spec, 1, seconds=40.0)])["motor time constant"]
    assert alike["value"] == pytest.approx(TRUTH["motor time constant"], rel=0.1)
    monkeypatch.setitem(TRUTH, "motor time constant", 0.08)
    other = told(spec, [first, flown(spec, 1, seconds=40.0)])
    assert "logs contradict each other" in other["motor time constant"]["known"]
    assert other["motor time constant"]["set"] == ""
    assert other["hover thrust"]["value"] == pytest.approx(HOVER, rel=0.02), "they agree in that"


def test_slow_thrust_tells_no_lag_and_what_would() -> None:
    spec = spec_of(4)
    own = told(spec, [flown(spec, seed, quick=0.1) for seed in range(3)])["motor time constant"]
    assert own["known"].startswith("cannot tell: the interval is 0.0")
    assert "fast vertical motion: 3 m/s^2 at 0.5 to 1.5 Hz" in own["known"]


def test_a_contradiction_is_what_chance_does_not_explain() -> None:
    deviations = np.array([[0.1, 0.1], [0.1, 0.1], [0.2, 0.2]])
    values = np.array([[1.0, 1.0], [1.2, 2.0], [0.9, 1.5]])
    none, much = contradiction(values, deviations)
    assert none == 1.0
    mean = (100.0 * 1.0 + 100.0 * 2.0 + 25.0 * 1.5) / 225.0
    birge = 100.0 * (1.0 - mean) ** 2 + 100.0 * (2.0 - mean) ** 2 + 25.0 * (1.5 - mean) ** 2
    assert much == pytest.approx(np.sqrt(birge / 2.0))


def test_a_flight_near_the_ground_and_its_start_do_not_count() -> None:
    spec = spec_of(4)
    logs = [flown(spec, seed) for seed in range(3)]
    low = logs[0].t > 10.0
    height = np.where(low, 0.1, 3.0)[:, None]
    force = logs[0]["specific_force"] + np.where(low, 3.0, 0.0)[:, None]
    near = [logs[0].put(ALTITUDE, height).put(SPECIFIC_FORCE, force), *logs[1:]]
    own, clean = (told(spec, flights)["hover thrust"]["value"] for flights in (near, logs))
    assert own == pytest.approx(clean, rel=2e-3)


def test_what_flights_cannot_tell_is_said() -> None:
    spec = spec_of(6)
    short = told(spec, [flown(spec, 0)])
    assert {row["known"] for row in short.values()} == {
        "cannot tell: 30 s of flight above the ground are needed"
    }
    assert all(row["value"] is None and row["set"] == "" for row in short.values())
    slow = told(spec, [flown(spec, seed, rate=40.0, seconds=25.0) for seed in range(2)])
    assert slow["motor time constant"]["known"] == "cannot tell: a log has less than 50 rows a second"
    assert slow["hover thrust"]["value"] == pytest.approx(HOVER, rel=0.02)
    bare = [flown(spec, seed).without("body_velocity", "body_acceleration", "altitude") for seed in range(2)]
    less = told(replace(spec, rotors=()), bare)
    assert "does not state the positions of its rotors" in less["centre of mass x"]["known"]
    assert "neither position nor velocity" in less["rotor drag y"]["known"]
    assert less["hover thrust"]["value"] == pytest.approx(HOVER, rel=0.02)


def test_a_vehicle_without_motors_and_a_kind_without_constants_are_answered() -> None:
    pelican = KIND.spec(KIND.built_in()["pelican"])
    assert {row["known"] for row in told(pelican, []).values()} == {"cannot tell: commands are not motors"}
    target = plugins.load("etude.targets", "parameters")
    with pytest.raises(UsageError, match="kind 'boat' have no parameters to report"):
        target(None, SimpleNamespace(name="boat"), None, {})
