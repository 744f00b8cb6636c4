"""Arms as a kind: what it recognises, the motions it offers, its presets and how light it is to load."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import FeasibleSet, certify, scaled
from etude.trajectories import FourierConfig
from etude_arm import KIND, ArmSpec, Axis
from etude_arm.preprocessing import ArmData
from etude_arm.robot_file import parse_robot

SPEC = KIND.spec(KIND.built_in()["arm4"])


@dataclass(frozen=True)
class Config:
    trajectory: FourierConfig = field(default_factory=FourierConfig)
    data: ArmData = field(default_factory=ArmData)


@pytest.mark.parametrize(
    ("name", "text", "ours"),
    [
        ("a.urdf", "", True),
        ("a.MJCF", "", True),
        ("a.xml", "", True),
        ("a.toml", "name = 'a'", True),
        ("a.toml", "kind = 'joints'", True),
        ("a.toml", "kind = 'arm'", True),
        ("a.toml", "kind = 'quadrotor'", False),
        ("a.toml", "kind = = 1", False),
        ("a.csv", "t,q", False),
    ],
)
def test_which_files_describe_an_arm(tmp_path: Path, name: str, text: str, ours: bool) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert KIND.recognises(path) is ours
    assert not KIND.recognises(tmp_path / "missing.toml")


def test_another_kind_of_robot_is_refused() -> None:
    with pytest.raises(UsageError, match="kind = 'boat' is not a robot with joints"):
        parse_robot(
            "kind = 'boat'\nname = 'b'\ncommand_unit = 'V'\nrate = 1\naxis = []", where="", folder=Path(".")
        )


@pytest.mark.parametrize("name", KIND.built_in())
def test_a_description_is_whole_and_reads_back_the_same(name: str, tmp_path: Path) -> None:
    path = KIND.built_in()[name]
    described = KIND.described(path)
    for file, data in described.files.items():
        (tmp_path / file).write_bytes(data)
    again = KIND.spec(tmp_path / "robot.toml")
    assert again.model_file == (tmp_path / "robot_model.xml").resolve()
    assert replace(again, model_file=None) == replace(KIND.spec(path), model_file=None)
    assert described.confirm == ()
    assert KIND.physics(again, Config())["identified"].geometry.tree.joints == again.dof


ODD = 'joint "one"\\2'


def test_odd_names_from_a_urdf_are_quoted_and_what_was_assumed_is_said(tmp_path: Path) -> None:
    path = tmp_path / "odd.urdf"
    limit = '<limit lower="-1" upper="2" velocity="3" effort="40"/>'
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    name = ODD.replace('"', "&quot;")
    path.write_text(
        f'<robot name="r"><link name="a"/><link name="b">{inertial}</link><link name="c">{inertial}</link>'
        f'<joint name="{name}&#10;x" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
        f'<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/>{limit}</joint></robot>'
    )
    described = KIND.described(path)
    (tmp_path / "robot_model.urdf").write_bytes(described.files["robot_model.urdf"])
    (tmp_path / "robot.toml").write_bytes(described.files["robot.toml"])
    spec = KIND.spec(tmp_path / "robot.toml")
    assert spec.names[0].startswith(ODD)
    assert [axis.unit for axis in spec.axes] == ["rad", "m"]
    assert len(described.confirm) == 1  # one sentence for all assumed accelerations
    assert '\\"one\\"' in described.confirm[0]
    assert '\nconfirm = [\n    "Acceleration limit' in described.files["robot.toml"].decode()


def test_channels_have_units_limits_and_roles() -> None:
    axes = (replace(SPEC.axes[0], unit="m"), *SPEC.axes[1:])
    channels = {channel.name: channel for channel in KIND.channels(replace(SPEC, axes=axes))}
    assert channels["qdd_des"].units == ("m/s^2", "rad/s^2", "rad/s^2", "rad/s^2")
    assert channels["qd"].derivative_of == "q"
    assert channels["qd_des"].derivative_of == "q_des"
    assert channels["q"].reach == (0.7854, 1.225, *channels["q"].reach[2:])
    assert [name for name, channel in channels.items() if channel.required] == ["q", "command"]
    assert channels["command"].units == ("pwm",) * 4
    assert channels["q_true"].role == "truth"
    expected = KIND.expected(SPEC)
    np.testing.assert_array_equal(expected.limits["q"], [SPEC.lower, SPEC.upper])
    np.testing.assert_array_equal(expected.scale, SPEC.upper - SPEC.lower)


def test_tests_and_ways_are_inside_every_limit_and_at_rest() -> None:
    limits = KIND.limits(SPEC, Config(), None, {})
    tests = KIND.tests(SPEC, Config(), np.random.default_rng(1))
    again = KIND.tests(SPEC, Config(), np.random.default_rng(1))
    assert set(tests) == {"fourier", "moves"}
    for name, motion in tests.items():
        found = certify(motion, limits)
        assert found.ok
        assert found.at_rest
        assert motion.to_json() == again[name].to_json()
    pose = SPEC.lower + 0.1
    approaches = KIND.approaches(SPEC, tests["fourier"], pose)
    assert approaches is not None
    assert all(certify(way, limits).ok for way in approaches)
    np.testing.assert_allclose(approaches[0].motion(np.zeros(1)).orders[0, 0], pose)
    start = tests["fourier"].motion(np.zeros(1)).orders[0, 0]
    np.testing.assert_allclose(approaches[0].motion(np.array([approaches[0].duration])).orders[0, 0], start)


def test_margins_of_tracking_narrow_the_limits() -> None:
    margin = np.full((3, 4), 0.01)
    wide, narrow = (KIND.limits(SPEC, Config(), None, m) for m in ({}, {"fourier": (margin, 0.9)}))
    family = KIND.family(SPEC, Config())
    drawn = family.trajectory(
        scaled(np.random.default_rng(0), FeasibleSet.of(wide, family, KIND.home(SPEC)))[0]
    )
    assert certify(drawn, wide).ok
    assert not certify(drawn, narrow).ok


def test_an_open_base_frequency_suits_the_robot() -> None:
    fast = ArmSpec("fast", (Axis("a", -1.0, 1.0, 3.0, 20.0, 1.0),), "A", 100.0)
    one, many = (KIND.family(spec, Config()).omega0 * 60.0 / (2.0 * np.pi) for spec in (SPEC, fast))
    assert one == pytest.approx(1.0)
    assert many > 5.0
    given = Config(FourierConfig(omega0=2.0 * np.pi / 30.0))
    assert KIND.family(fast, given).omega0 == pytest.approx(2.0 * np.pi / 30.0)


def test_presets_and_comments_name_existing_keys_only() -> None:
    assert {"default", "thesis"} <= set(KIND.presets)
    for table, kind in KIND.tables.items():
        keys = {one.name for one in fields(kind)}
        assert set(KIND.comments[table]) == keys
        for preset in KIND.presets.values():
            assert set(preset.get(table, {})) <= keys
    assert ArmData(**KIND.presets["thesis"]["data"]).desired


def test_baselines_are_feedback_alone_and_the_exact_inverse() -> None:
    assert set(KIND.baselines(SPEC, Config())) == {"pd", "perfect"}
    nobody = replace(SPEC, plant=None, model_file=None)
    assert set(KIND.baselines(nobody, Config())) == {"pd"}
    assert KIND.robot(nobody, Config()) is None
    with pytest.raises(UsageError, match="'shoulder' is driven by a tendon"):
        KIND.robot(replace(SPEC, plant=None), Config())


def test_the_kind_is_light_to_load() -> None:
    code = "import sys, etude_arm.kind as k; k.KIND.built_in(); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for heavy in ("mujoco", "numba", "scipy", "polars", "msgspec"):
        assert heavy not in loaded.split(), heavy
