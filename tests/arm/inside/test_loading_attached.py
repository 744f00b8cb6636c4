"""Mounting, tool and payload: in the robot file, in the masses and in the shapes, alike in both formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from loading_examples import write

from etude.errors import UsageError
from etude_arm import ArmSpec
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.loading.load import load_arm
from etude_arm.model_file import spec_from_model
from etude_arm.robot_file import parse_robot, robot_to_toml

MJCF = """<mujoco><worldbody><body name="a" pos="0 0 .2"><joint name="one" axis="0 1 0" range="-1 1"/>
  <geom size=".1" mass="1"/><body name="b" pos=".5 0 0"><joint name="two" axis="0 1 0" range="-1 1"/>
  <geom type="box" size=".1 .1 .1" mass="1"/></body></body></worldbody></mujoco>"""
LOAD = Attached(
    mass=2.0, centre=(0.3, 0.0, 0.0), shape="box", size=(0.1, 0.2, 0.3), rotation=(0.0, 0.0, np.pi / 2)
)


@pytest.fixture(params=["urdf", "mjcf"])
def spec(request: pytest.FixtureRequest, tmp_path: Path) -> ArmSpec:
    if request.param == "urdf":
        return spec_from_model(write(tmp_path)).spec
    (tmp_path / "arm.xml").write_text(MJCF)
    limits = {"velocity": 1.0, "command": 10.0}
    return spec_from_model(tmp_path / "arm.xml", given={"one": limits, "two": limits}).spec


def forward(spec: ArmSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = load_arm(spec).model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_a_payload_weighs_and_has_a_shape(spec: ArmSpec) -> None:
    bare, before = forward(spec)
    model, data = forward(replace(spec, payload=LOAD))
    tip = bare.njnt - 1
    body = model.body(int(model.jnt_bodyid[tip])).name
    np.testing.assert_allclose(model.body(body).mass - bare.body(body).mass, 2.0, rtol=1e-12)
    centre = data.body(body).xpos + data.body(body).xmat.reshape(3, 3) @ LOAD.centre
    np.testing.assert_allclose(data.geom("payload#0").xpos, centre, atol=1e-12)
    np.testing.assert_allclose(model.geom("payload#0").size, [0.05, 0.1, 0.15])
    lever = np.cross(data.xaxis[tip], centre - data.xanchor[tip])
    added = data.qfrc_bias[tip] - before.qfrc_bias[tip]
    np.testing.assert_allclose(added, -2.0 * model.opt.gravity @ lever, rtol=1e-9, atol=1e-12)


def test_a_shape_gives_the_inertia_of_a_homogeneous_body() -> None:
    np.testing.assert_allclose(np.diag(LOAD.moments()), 2 / 12 * np.array([0.01 + 0.09, 0.04 + 0.09, 0.05]))
    ball = Attached(mass=3.0, shape="sphere", size=(0.2,), shape_centre=(0.0, 0.0, 0.5))
    np.testing.assert_allclose(np.diag(ball.moments()), 0.4 * 3 * 0.04 + np.array([0.75, 0.75, 0.0]))
    rod = Attached(mass=1.0, shape="cylinder", size=(0.1, 0.6))
    np.testing.assert_allclose(np.diag(rod.moments()), [0.0325, 0.0325, 0.005])


def test_the_inertia_reaches_the_model(spec: ArmSpec) -> None:
    """About its own centre a payload alone resists as the formula says: differences of the mass matrix."""
    point = replace(
        LOAD, shape="none", size=(), rotation=(0.0,) * 3, inertia=(1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0)
    )
    found = []
    for one in (LOAD, point):
        model, data = forward(replace(spec, payload=one))
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        axis = data.body(int(model.jnt_bodyid[-1])).xmat.reshape(3, 3).T @ data.xaxis[-1]
        found.append(full[-1, -1])
    np.testing.assert_allclose(found[0] - found[1], axis @ LOAD.moments() @ axis, rtol=1e-5)


def test_a_base_on_the_ceiling_turns_gravity_round(spec: ArmSpec) -> None:
    _, data = forward(spec)
    model, hanging = forward(replace(spec, mounting=Mounting((0.0, 0.0, 2.0), (np.pi, 0.0, 0.0))))
    np.testing.assert_allclose(hanging.qfrc_bias, -data.qfrc_bias, rtol=1e-9)
    for g in range(model.ngeom):
        x, y, z = data.geom(model.geom(g).name).xpos
        np.testing.assert_allclose(hanging.geom(g).xpos, [x, -y, 2 - z], atol=1e-12)


def test_without_a_shape_nobody_looked_at_it(spec: ArmSpec) -> None:
    assert (
        "the shape of the tool: none is given"
        in load_arm(replace(spec, tool=Attached(mass=1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0)))).unverified
    )
    with pytest.raises(UsageError, match=r"there is no (link|body) 'flange'"):
        load_arm(replace(spec, tool=replace(LOAD, link="flange")))


def test_the_robot_file_holds_them_and_reads_back(spec: ArmSpec) -> None:
    whole = replace(spec, mounting=Mounting((0.0, 0.1, 0.8)), tool=replace(LOAD, link="b"), payload=LOAD)
    assert parse_robot(robot_to_toml(whole), where="robot.toml", folder=Path()) == whole


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("mass = 1.0", "neither an inertia nor a shape.*State shape"),
        ('mass = 0.0\nshape = "sphere"\nsize = [0.1]', "a mass of 0 kg is not possible"),
        ('mass = 1.0\nshape = "box"\nsize = [0.1]', r"a box has 3 sizes above zero, not \[0.1\]"),
        ('mass = 1.0\nshape = "egg"', 'not "egg"'),
        ("mass = 1.0\ninertia = [1.0, 1.0, 3.0, 0.0, 0.0, 0.0]", "no body can have this inertia"),
        ("weight = 1.0", "unknown key 'weight'"),
    ],
)
def test_a_payload_that_cannot_be_is_refused_with_its_table(tmp_path: Path, table: str, words: str) -> None:
    text = robot_to_toml(spec_from_model(write(tmp_path)).spec) + f"\n[payload]\n{table}\n"
    with pytest.raises(UsageError, match=words) as refused:
        parse_robot(text, where="robot.toml", folder=Path())
    assert refused.value.where.startswith("robot.toml [payload]")
