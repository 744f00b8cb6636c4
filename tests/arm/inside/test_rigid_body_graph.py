"""The rigid body as a graph says what NumPy says, of a robot with everything awkward; and its memory too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from rigid_examples import AWKWARD, NAMES, awkward_spec, smooth_motion

from etude._runtime.operators import Value
from etude.deploy import Graph, session
from etude.types import Array, Log
from etude_arm import ArmInputs
from etude_arm.memory import remembered
from etude_arm.onnx import followed
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.regressor import nominal_parameters
from etude_arm.physics.rigid_body import RigidBodyModel
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco
from etude_arm.physics.transmission import joint_drives
from etude_arm.spec import PATH, PRESLIDING_DISTANCES, RIPPLES

for library in ("onnx", "onnxruntime"):
    pytest.importorskip(library, reason="graphs are written and run by the extra 'onnx'")


def model(linked: bool) -> RigidBodyModel:
    """Parameters of each output far from the file's; without linkages friction turns round over ways."""
    loaded = mujoco.MjModel.from_xml_string(AWKWARD)
    tree = tree_from_mujoco(loaded, NAMES)
    drives = drives_from_mujoco(loaded, NAMES) if linked else joint_drives(len(NAMES))
    rng = np.random.default_rng(2)
    inertial = nominal_parameters(tree) * np.exp(0.3 * rng.normal(size=(len(NAMES), tree.bodies * 10 - 10)))
    extra, unknown = rng.normal(size=(len(NAMES), 6)), np.full((len(NAMES), 6), np.inf)
    way = (
        np.zeros(5)
        if linked
        else np.array(
            [
                PRESLIDING_DISTANCES[0],
                0.0,
                PRESLIDING_DISTANCES[2],
                PRESLIDING_DISTANCES[3],
                PRESLIDING_DISTANCES[0],
            ]
        )
    )
    rank = np.zeros(5, dtype=np.int64)
    return RigidBodyModel(tree, drives, np.full(5, 0.02), inertial, extra, rank, np.ones(5), unknown, way)


def session_of(draw: Any, names: tuple[str, ...], J: int, words: int = 0) -> Callable[..., list[Array]]:
    """A part as a graph: channels (n, J), one after the other, and a memory (n, words) -> values, memory."""
    graph = Graph(np.float64)
    values = {name: Value(graph, "states").at(range(i * J, i * J + J)) for i, name in enumerate(names)}
    found, after = draw(values, Value(graph, "memory") if words else None)
    outputs, inputs = {"out": (found.name, J)}, {"states": J * len(names)}
    if words:
        outputs["after"], inputs["memory"] = (after.name, words), words
    return session(graph.model(inputs, outputs, {}, ""))


@pytest.mark.parametrize("linked", [True, False], ids=["linkages", "joints"])
def test_commands_are_numpys(linked: bool) -> None:
    ripple = np.random.default_rng(4).normal(size=(5, 2 * RIPPLES))
    own = replace(model(linked), ripple=ripple)
    _, q, qd, qdd = smooth_motion(np.random.default_rng(5), 40, len(NAMES))
    mean = RigidBodyMean(replace(own, way=np.zeros(5)), awkward_spec())
    (told,) = session_of(mean.onnx().draw, PATH, len(NAMES))(np.concatenate([q, 3.0 * qd, qdd], axis=1))
    wanted = own.predict(q, 3.0 * qd, qdd)
    assert np.abs(told - wanted).max() < 1e-10 * np.abs(wanted).max()


def test_friction_that_turns_round_is_carried() -> None:
    own, spec = model(linked=False), awkward_spec()
    _, q, qd, qdd = smooth_motion(np.random.default_rng(6), 60, len(NAMES), step=0.02)
    mean = RigidBodyMean(own, spec)
    ask, memory, told = session_of(mean.onnx().draw, PATH, len(NAMES), 11), np.zeros((1, 11)), []
    for row in np.concatenate([q, qd, qdd], axis=1):
        out, memory = ask(row[None], memory)
        told.append(out[0])
    channels = {c.name: c for c in spec.channels()}
    states = Log(np.arange(60) * 0.02, channels, dict(zip(PATH, (q, qd, qdd), strict=True)))
    wanted = mean.predict(ArmInputs.of(spec, 0.02, physics=True).followed(states))
    assert np.abs(np.array(told) - wanted).max() < 1e-10 * np.abs(wanted).max()
    assert np.abs(own.predict(q, qd, qdd) - wanted).max() > 0.1


def test_what_friction_remembers_waits_behind_the_play() -> None:
    rng = np.random.default_rng(7)
    q = np.cumsum(0.01 * rng.normal(size=(50, 2)), axis=0)
    play, length = np.array([0.005, 0.0]), np.array([0.01, 0.02])
    ask = session_of(lambda states, memory: followed(states["q"], memory, play, length), ("q",), 2, 5)
    memory, told = np.zeros((1, 5)), []
    for row in q:
        _, memory = ask(row[None], memory)
        told.append(memory[0])
    wanted = remembered(q, play, length).reshape(50, 4)
    assert np.abs(np.array(told)[:, :4] - wanted).max() < 1e-14
