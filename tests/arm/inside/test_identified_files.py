"""A robot whose file is wrong: what is written is possible, and MuJoCo plays the true one's forces."""

from __future__ import annotations

import re
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from loading_examples import write

from etude.errors import UsageError
from etude.types import Log, Samples
from etude_arm import KIND, ArmPhysics, ArmSpec, Axis
from etude_arm.config import ArmData
from etude_arm.identified.consistent_parameters import Identified, identified, links_of
from etude_arm.identified.model_file_writer import central, written
from etude_arm.identified.pseudo_inertia import is_possible, matrix_of
from etude_arm.identified.target import URDF, digits, extrapolated
from etude_arm.loading.attachments import Attached
from etude_arm.loading.load import load
from etude_arm.physics.kinematics import body_motion
from etude_arm.physics.regressor import regressor_of_motion

NAMES = ("shoulder", "elbow", "wrist")
FRICTION = np.array([1.5, 0.8, 0.3])
ROUNDS = 3
MJCF = """<mujoco><worldbody><body name="one"><joint name="a" axis="0 1 0"/>
<geom type="box" size=".05 .04 .2" pos="0 0 .2" mass="2"/>
<body name="two" pos="0 0 .4"><joint name="b" axis="0 1 .2" damping="7"/>
<geom type="box" size=".03 .03 .15" pos="0 .05 .15" mass="1"/>
<body name="tip" pos="0 0 .3"><geom size=".05" mass=".4"/></body></body></body></worldbody></mujoco>"""


def spec_of(path: Path, names: tuple[str, ...] = NAMES) -> ArmSpec:
    return ArmSpec("arm", tuple(Axis(n, -1.0, 1.0, 2.0, 6.0, 60.0) for n in names), "N m", 100.0, path)


def torques(path: Path, names: tuple[str, ...], q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """By MuJoCo's inverse dynamics, without friction."""
    loaded = load(path, names, shapes=False)
    model = loaded.model()
    model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = 0.0, 0.0, 0.0
    data, at = mujoco.MjData(model), loaded.columns(model)
    found = np.zeros_like(q)
    for i in range(len(q)):
        data.qpos[at], data.qvel[at], data.qacc[at] = q[i], qd[i], qdd[i]
        mujoco.mj_inverse(model, data)
        found[i] = data.qfrc_inverse[at]
    return found


def motion(rng: np.random.Generator, samples: int, dof: int) -> tuple[np.ndarray, ...]:
    t, k = 0.05 * np.arange(samples), np.arange(1, 5)[:, None, None]
    size, phase = rng.uniform(0.05, 0.25, (4, 1, dof)), rng.uniform(0, 6.3, (4, 1, dof))
    angle = 0.7 * k * t[:, None] + phase
    return (
        np.sum(size * np.sin(angle), axis=0),
        np.sum(0.7 * k * size * np.cos(angle), axis=0),
        np.sum(-((0.7 * k) ** 2) * size * np.sin(angle), axis=0),
    )


def told(spec: ArmSpec, path: Path, friction: np.ndarray, noise: float = 0.01) -> Samples:
    """Logs of a robot that is the one of `path`, with friction that none of the files has."""
    rng = np.random.default_rng(4)
    parts = [motion(rng, 300, spec.dof) for _ in range(ROUNDS)]
    q, qd, qdd = (np.concatenate([part[i] for part in parts]) for i in range(3))
    command = torques(path, spec.names, q, qd, qdd) + friction * np.tanh(qd / 0.04)
    command += noise * rng.normal(size=q.shape)
    channels = {c.name: c for c in spec.channels()}
    values = {"q": q, "qd": qd, "qdd": qdd, "command": command}
    log = Log(0.05 * np.arange(len(q)), {name: channels[name] for name in values}, values)
    return Samples(log, np.repeat(np.arange(ROUNDS), 300), np.ones(q.shape, bool), np.abs(qd) > 0.02)


def given(samples: Samples) -> dict[str, Any]:
    """What a campaign supplies a target with."""
    return {"samples": samples, "config": SimpleNamespace(data=ArmData()), "model_hash": ""}


def heavier(path: Path, new: Path) -> Path:
    """The same robot with other masses, which is the real one."""
    root = ET.parse(path).getroot()
    for factor, mass in zip((1.4, 0.7, 1.3, 1.0, 1.2), root.iter("mass"), strict=False):
        mass.set("value", repr(factor * float(mass.get("value", ""))))
    for factor, inertia in zip((1.3, 0.8, 1.2, 1.0, 1.1), root.iter("inertia"), strict=False):
        for key in inertia.attrib:
            inertia.set(key, repr(factor * float(inertia.get(key, ""))))
    new.write_bytes(ET.tostring(root))
    return new


@pytest.fixture(scope="module")
def wrong_file(tmp_path_factory: pytest.TempPathFactory) -> tuple[ArmSpec, Path, Identified]:
    path = write(tmp_path_factory.mktemp("robot"))
    real = heavier(path, path.with_name("real.urdf"))
    spec = spec_of(path)
    samples = told(spec, real, FRICTION)
    return spec, real, identified(samples, spec, ArmPhysics(spec)(samples))


def test_every_link_has_its_own_place_and_those_held_too(
    wrong_file: tuple[ArmSpec, Path, Identified],
) -> None:
    spec, _, found = wrong_file
    assert [name for name, _ in found.links.identifiable] == ["upper", "fore", "hand", "left", "right"]
    for name, place in found.links.identifiable:
        assert is_possible(found.result.phi[place]), name
    assert found.links.tree.joints == spec.dof


def test_segments_left_out_are_predicted_better_than_by_the_file(
    wrong_file: tuple[ArmSpec, Path, Identified],
) -> None:
    errors = wrong_file[2].errors
    assert errors.segments == ROUNDS
    assert np.all(errors.identified < 0.015)
    assert np.all(errors.file[:2] > 4.0 * errors.identified[:2])


def test_the_written_file_plays_the_real_robots_forces(
    wrong_file: tuple[ArmSpec, Path, Identified], tmp_path: Path
) -> None:
    spec, real, found = wrong_file
    assert spec.model_file is not None
    bodies = {name: found.result.phi[place] for name, place in found.links.identifiable}
    files = written(spec, bodies, found.joints)
    assert list(files) == ["arm.urdf"]
    new = spec.model_file.with_name("new.urdf")
    new.write_bytes(files["arm.urdf"])
    states = motion(np.random.default_rng(99), 200, spec.dof)
    true, before, after = (torques(p, spec.names, *states) for p in (real, spec.model_file, new))
    armature = np.array([found.joints[joint].armature for joint in spec.names]) * states[2]
    wrong, left = (np.sqrt(np.mean((x - true) ** 2, axis=0)) for x in (before, after + armature))
    assert np.all(left < 0.03)
    assert np.all(left[:2] < 0.2 * wrong[:2])
    again = links_of(replace(spec, model_file=new))
    np.testing.assert_allclose(again.nominal, found.result.phi, rtol=1e-9, atol=1e-12)
    old_joints = ET.parse(spec.model_file).getroot().findall("joint")
    for old, one in zip(old_joints, ET.parse(new).getroot().findall("joint"), strict=True):
        assert [part.tag for part in one if part.tag != "dynamics"] == [part.tag for part in old]
        dynamics = one.find("dynamics")
        if old.get("name") in NAMES:
            assert dynamics is not None
            assert float(dynamics.get("friction", "")) == pytest.approx(
                FRICTION[NAMES.index(old.get("name", ""))], rel=0.15
            )


def test_an_mjcf_is_written_as_one(tmp_path: Path) -> None:
    path = tmp_path / "two.xml"
    path.write_text(MJCF)
    spec = spec_of(path, ("a", "b"))
    real = tmp_path / "real.xml"
    real.write_text(MJCF.replace('mass="2"', 'mass="2.7"').replace('mass=".4"', 'mass=".9"'))
    samples = told(spec, real, np.array([0.5, 0.2]))
    found = identified(samples, spec, ArmPhysics(spec)(samples))
    bodies = {name: found.result.phi[place] for name, place in found.links.identifiable}
    assert set(bodies) == {"one", "two", "tip"}
    files = written(spec, bodies, found.joints)
    assert list(files) == ["two.xml"]
    new = tmp_path / "new_two.xml"
    new.write_bytes(files["two.xml"])
    model = mujoco.MjModel.from_xml_path(str(new))
    for body, phi in bodies.items():
        mass, centre, inertia = central(phi)
        one = model.body(body)
        assert one.mass[0] == pytest.approx(mass, rel=1e-4)
        np.testing.assert_allclose(one.ipos, centre, atol=1e-4)
        np.testing.assert_allclose(np.sort(one.inertia), np.linalg.eigvalsh(inertia), rtol=1e-3, atol=1e-6)
    assert model.dof_damping[1] == pytest.approx(found.joints["b"].damping, rel=1e-4)
    assert model.dof_frictionloss[0] == pytest.approx(0.5, rel=0.2)
    states = motion(np.random.default_rng(98), 100, 2)
    true, before, after = (torques(p, ("a", "b"), *states) for p in (real, path, new))
    assert np.abs(after - true).max() < 0.1 * np.abs(before - true).max()


def test_the_matrix_of_a_body_and_its_central_inertia_agree() -> None:
    mass, centre, inertia = central(np.array([2.0, 0.2, -0.1, 0.4, 0.3, 0.32, 0.2, 0.01, -0.02, 0.03]))
    assert mass == 2.0
    second = matrix_of(np.array([2.0, 0.2, -0.1, 0.4, 0.3, 0.32, 0.2, 0.01, -0.02, 0.03]))[:3, :3]
    about = second - mass * np.outer(centre, centre)
    np.testing.assert_allclose(np.trace(about) * np.eye(3) - about, inertia, atol=1e-15)


def test_the_target_says_what_is_known_and_refuses_what_is_no_force(
    wrong_file: tuple[ArmSpec, Path, Identified],
) -> None:
    spec, real, found = wrong_file
    assert spec.model_file is not None
    samples = told(spec, real, FRICTION)
    delivered = URDF(None, KIND, spec, given(samples))
    assert set(delivered.files) == {"arm.urdf", "identifiability.csv", "identifiability.json", "README.md"}
    table = delivered.files["identifiability.csv"].decode().splitlines()
    assert len(table) == 1 + 10 * 5
    rows = {(row["link"], row["parameter"]): row for row in delivered.facts["parameters"]}
    assert {row["known"] for row in rows.values()} <= {"measured", "partly", "from the file"}
    assert rows["right", "Ixy"]["known"] == "from the file"
    assert max(row["share"] for row in rows.values()) > 0.75
    assert "partly" in {row["known"] for row in rows.values()}
    assert any("Error on held-out segments" in sentence for sentence in delivered.notes)
    assert not any("do not use" in sentence for sentence in delivered.notes)
    with pytest.raises(UsageError, match="motors' constants"):
        URDF(None, KIND, replace(spec, command_unit="A"), given(samples))
    with pytest.raises(UsageError, match="no model file"):
        URDF(None, KIND, replace(spec, model_file=None), given(samples))
    with pytest.raises(UsageError, match="no option"):
        URDF(None, KIND, spec, given(samples) | {"real": "float"})
    same = told(spec, spec.model_file, FRICTION)
    again = URDF(None, KIND, spec, given(same))
    assert any("predict equally well" in sentence for sentence in again.notes)
    assert found.measured == delivered.facts["told"] <= found.shown


def test_friction_that_was_seen_at_slow_speeds_alone_is_said_to_be_extrapolated(
    wrong_file: tuple[ArmSpec, Path, Identified],
) -> None:
    spec, _, found = wrong_file
    name, fastest = next(iter((name, terms.fastest) for name, terms in found.joints.items()))
    for part, said in ((0.6, False), (0.4, True)):
        axes = tuple(replace(one, velocity=fastest / part if one.name == name else 1e-3) for one in spec.axes)
        sentences = extrapolated(found, replace(spec, axes=axes))
        assert len(sentences) == said
        if said:
            assert f"({name} {digits(fastest)} of {digits(fastest / part)} rad/s)" in sentences[0]


def test_a_urdf_is_right_beside_the_payload_that_is_printed(tmp_path: Path) -> None:
    """The real robot carries nothing, and robot.toml says half a kilogram: the file alone is wrong."""
    path = write(tmp_path)
    real = heavier(path, path.with_name("real.urdf"))
    carried = Attached(mass=0.5, centre=(0.0, 0.02, 0.1), inertia=(1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
    spec = replace(spec_of(path), payload=carried)
    delivered = URDF(None, KIND, spec, given(told(spec, real, FRICTION)))
    (printed,) = (line.partition("[payload] ")[2] for line in delivered.notes if "[payload]" in line)
    table = tomllib.loads(re.sub(r", (?=[a-z])", "\n", printed.rstrip(".")))
    new = path.with_name("new.urdf")
    new.write_bytes(delivered.files["arm.urdf"])
    states = motion(np.random.default_rng(99), 200, spec.dof)
    errors = {}
    for name, payload in (("printed", Attached(**table)), ("told", carried)):
        links = links_of(replace(spec, model_file=new, payload=payload))
        played = regressor_of_motion(links.tree, body_motion(links.tree, *states)) @ links.nominal
        errors[name] = np.sqrt(np.mean((played - torques(real, spec.names, *states)) ** 2, axis=0))
    assert np.all(errors["printed"] < 0.1)
    assert errors["told"].max() > 5.0 * errors["printed"].max()
