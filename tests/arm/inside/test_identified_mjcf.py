"""What `--to mjcf` writes is what was identified: MuJoCo plays its forces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from loading_examples import write
from test_identified_files import FRICTION, NAMES, given, heavier, motion, spec_of, told
from test_identified_files import MJCF as TWO

from etude.errors import UsageError
from etude_arm import KIND, ArmSpec
from etude_arm.identified.consistent_parameters import links_of
from etude_arm.identified.model_file_writer import Dip, JointTerms, mjcf
from etude_arm.identified.replayed import inverse
from etude_arm.identified.target import MJCF
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.physics.kinematics import body_motion
from etude_arm.physics.regressor import regressor_of_motion
from etude_arm.spec import Gains

CARRIED = Attached(mass=0.5, centre=(0.0, 0.02, 0.1), inertia=(1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
WALL = Mounting(rotation=(1.0, 0.2, 0.0))


def compiled(files: dict[str, bytes], name: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        files[name or next(iter(files))].decode(),
        {one.rsplit("/", 1)[-1]: data for one, data in files.items()},
    )


@pytest.fixture(params=["urdf", "mjcf"])
def spec(request: pytest.FixtureRequest, tmp_path: Path) -> ArmSpec:
    if request.param == "urdf":
        return spec_of(write(tmp_path))
    path = tmp_path / "two.xml"
    path.write_text(TWO)
    return spec_of(path, ("a", "b"))


@pytest.mark.parametrize("more", ["bare", "carrying", "one held"])
def test_mujoco_plays_the_parameters_that_are_written(spec: ArmSpec, more: str) -> None:
    if more == "carrying":
        spec = replace(spec, payload=CARRIED, mounting=WALL)
    elif more == "one held":
        spec = replace(spec, axes=spec.axes[:-1], held={spec.names[-1]: 0.4})
    links = links_of(spec)
    phi = links.nominal * 1.1
    terms = {name: JointTerms(0.3 + j, 0.0, 0.0) for j, name in enumerate(spec.names)}
    model = compiled(mjcf(spec, {name: phi[place] for name, place in links.identifiable}, terms))
    states = motion(np.random.default_rng(1), 60, spec.dof)
    rigid = regressor_of_motion(links.tree, body_motion(links.tree, *states)) @ phi
    wanted = rigid + states[2] * (0.3 + np.arange(spec.dof))
    np.testing.assert_allclose(inverse(model, spec, *states), wanted, atol=1e-5 * np.abs(wanted).max())


def test_friction_brakes_a_joint_that_turns_fast(spec: ArmSpec) -> None:
    terms = {name: JointTerms(0.01, 0.4, 0.7) for name in spec.names}
    free, braked = (compiled(mjcf(spec, {}, own)) for own in ({}, terms))
    free.dof_damping[:] = 0.0
    states = [4.0 * part for part in motion(np.random.default_rng(2), 60, spec.dof)]
    fast = np.abs(states[1]) > 1.0
    more = inverse(braked, spec, *states) - inverse(free, spec, *states) - 0.01 * states[2]
    wanted = 0.4 * states[1] + 0.7 * np.sign(states[1])
    assert fast.any()
    np.testing.assert_allclose(more[fast], wanted[fast], atol=0.03)


def test_a_second_file_has_cogging_and_dips_of_friction(tmp_path: Path) -> None:
    """Whatever a file's defaults say of actuators; its own take the same controls."""
    path = tmp_path / "two.xml"
    default = '<general gear="50" forcerange="-.1 .1" forcelimited="true" damping="9"/></default>'
    motor = '<actuator><position joint="a" kp="77"/></actuator></mujoco>'
    path.write_text(TWO.replace("<mujoco>", "<mujoco><default>" + default).replace("</mujoco>", motor))
    spec = spec_of(path, ("a", "b"))
    waves = ((2, 0.3, 0.5), (5, 0.2, -2.0))
    terms = {
        "a": JointTerms(0.1, 0.2, 0.3, waves),
        "b": JointTerms(0.1, 0.2, 0.3, (), Dip(0.15, 0.25, 0.4, 0.9)),
    }
    files = mjcf(spec, {}, terms)
    plain, drives = compiled(files), compiled(files, "two_drives.xml")
    assert plain.nu == drives.nu == 1
    states = [4.0 * part for part in motion(np.random.default_rng(3), 60, spec.dof)]
    more = inverse(drives, spec, *states) - inverse(plain, spec, *states)
    wanted = sum(size * np.sin(periods * states[0][:, 0] + phase) for periods, size, phase in waves)
    np.testing.assert_allclose(more[:, 0], -wanted, atol=1e-9)
    v = states[1][:, 1]
    law = (0.15 - 0.2) * v + (0.25 - 0.3 + 0.4 * np.exp(-((v / 0.9) ** 2))) * np.sign(v)
    fast = np.abs(v) > 0.3
    assert fast.sum() > 20
    np.testing.assert_allclose(more[fast, 1], law[fast], atol=2e-3)
    assert list(mjcf(spec, {}, {})) == ["two.xml"]


def test_a_urdf_gets_motors_or_servos_where_gains_are_known(tmp_path: Path) -> None:
    spec = spec_of(write(tmp_path))
    motors, servos = (
        compiled(mjcf(one, {}, {})) for one in (spec, replace(spec, gains=Gains((9.0, 8.0, 7.0))))
    )
    for j, name in enumerate(NAMES):
        assert motors.actuator(name).ctrlrange.tolist() == [-60.0, 60.0]
        assert motors.actuator(name).biastype == mujoco.mjtBias.mjBIAS_NONE
        assert servos.actuator(name).gainprm[0] == 9.0 - j
        assert servos.actuator(name).forcerange.tolist() == [-60.0, 60.0]


def test_a_root_link_may_be_called_world(tmp_path: Path) -> None:
    """As of a UR5 and an xArm7: MuJoCo keeps that name for itself."""
    path = write(tmp_path)
    spec = spec_of(path)
    own = compiled(mjcf(spec, {}, {}))
    path.write_text(path.read_text().replace('"base"', '"world"'))
    model = compiled(mjcf(spec, {}, {}))
    assert model.nbody == own.nbody
    np.testing.assert_array_equal(model.body_mass, own.body_mass)


def test_an_mjcf_keeps_its_meshes_and_its_actuators(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    triangles = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (tmp_path / "parts" / "tip.obj").write_text(triangles)
    path = tmp_path / "two.xml"
    path.write_text(
        TWO.replace("<mujoco>", '<mujoco><compiler meshdir="parts"/><asset><mesh file="tip.obj"/></asset>')
        .replace('<geom size=".05" mass=".4"/>', '<geom type="mesh" mesh="tip" mass=".4"/>')
        .replace("</mujoco>", '<actuator><position joint="a" kp="77"/></actuator></mujoco>')
    )
    files = mjcf(spec_of(path, ("a", "b")), {}, {})
    folder = tmp_path / "out"
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    model = mujoco.MjModel.from_xml_path(str(folder / "two.xml"))
    assert model.nmesh == 1
    assert model.actuator_gainprm[0, 0] == 77.0


def test_the_target_says_how_the_file_predicts_the_logs(tmp_path: Path) -> None:
    path = write(tmp_path)
    spec = spec_of(path)
    samples = told(spec, heavier(path, tmp_path / "real.urdf"), FRICTION, noise=0.3)
    delivered = MJCF(None, KIND, spec, given(samples))
    assert next(iter(delivered.files)) == "arm.xml"
    played = delivered.facts["played"]
    for name, friction in zip(NAMES, FRICTION, strict=True):
        assert played["physics"][name] == pytest.approx(0.3, rel=0.1)
        beside = played["file"][name] ** 2 - played["physics"][name] ** 2
        assert beside < (0.2 * friction) ** 2, "friction that turns over with speed is all that it lacks"
        assert played["drives"][name] == played["file"][name]
    assert "The logs show no cogging and no Stribeck's dip." in delivered.notes
    assert not [file for file in delivered.files if "cogging" in file or "drives" in file]
    assert any("MuJoCo's inverse dynamics of the file" in sentence for sentence in delivered.notes)
    assert any("no Stribeck's dip" in sentence for sentence in delivered.notes)
    assert "no Stribeck's dip" in delivered.files["README.md"].decode()
    with pytest.raises(UsageError, match="motors' constants"):
        MJCF(None, KIND, replace(spec, command_unit="A"), given(samples))
