"""Which way gravity pulls, by the commands: told where they leave no doubt, and of right logs never."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_motion import COMMAND, DRY, INERTIA, VISCOUS, moved

from etude.campaign import inspect
from etude.logs import seen
from etude.types import Array, Finding
from etude_arm.log_checks import mounting_finding

DOWN = np.array([0.0, 0.0, -9.81])
EXAMPLES = Path(__file__).parents[3] / "examples"
SIDEWAYS = np.array([9.81, 0.0, 0.0])


def pulls_of(q: Array) -> Array:
    """(n, 3, 3) of a hip that turns upright, then two joints that lift what hangs on them: closed form."""
    hip, knee, both = q[:, 0], q[:, 1], q[:, 1] + q[:, 2]
    out, up = 2.0 * np.cos(knee) + np.cos(both), 2.0 * np.sin(knee) + np.sin(both)
    zero = np.zeros_like(hip)
    lift = [-np.cos(hip) * up, -np.sin(hip) * up, out]
    toe = [-np.cos(hip) * np.sin(both), -np.sin(hip) * np.sin(both), np.cos(both)]
    turn = [-np.sin(hip) * out, np.cos(hip) * out, zero]
    return -np.stack([np.stack(rows, axis=1) for rows in (turn, lift, toe)], axis=1)


def told(
    true: Array, file: Array = DOWN, *, sign: float = 1.0, noise: float = 0.1, moving: int = 3
) -> Finding | None:
    """Of a made log, its robot mounted so that gravity is `true`, and a model file that says `file`."""
    log = moved()
    q, qd, qdd = log["q"].copy(), log["qd"].copy(), np.gradient(log["qd"], log.t, axis=0)
    for part in (q, qd, qdd):
        part[:, : 3 - moving] = 0.0
    rng = np.random.default_rng(1)
    command = INERTIA * qdd + VISCOUS * qd + DRY * np.tanh(qd / 0.05) + pulls_of(q) @ true
    command = sign * command + noise * rng.standard_normal(command.shape)
    made = log.put(log.channels["q"], q).put(log.channels["qd"], qd).put(COMMAND, command)
    motion = seen(made, made.channels["q"])
    assert motion is not None
    return mounting_finding(motion, INERTIA * motion.qdd, pulls_of(motion.q), file)


def turned(degrees: float) -> Array:
    """Gravity of a base that leans about x."""
    a = np.radians(degrees)
    return np.array([0.0, 9.81 * np.sin(a), -9.81 * np.cos(a)])


@pytest.mark.parametrize("degrees", [30.0, 90.0, 135.0, 180.0])
def test_a_leaning_base_is_told_with_its_angle(degrees: float) -> None:
    for true, file in ((turned(degrees), DOWN), (DOWN, turned(degrees))):
        found = told(true, file)
        assert found is not None
        assert (found.light, found.flag) == ("red", "mounting")
        assert f", {degrees:.0f} degrees off" in found.sentence
    sideways = told(SIDEWAYS)
    assert sideways is not None
    assert "gravity of (9.8, 0, 0) m/s^2 in the model file's world, 90 degrees off its (0, 0, -9.8)" in (
        sideways.sentence
    )


@pytest.mark.parametrize(
    "true", [DOWN, 1.3 * DOWN, 0.2 * DOWN, 5.0 * SIDEWAYS, 0.05 * SIDEWAYS, np.zeros(3), turned(10.0)]
)
def test_right_ones_and_other_faults_are_not(true: Array) -> None:
    """Heavier or lighter than the file, commands in another unit, or without gravity, a slight lean."""
    assert told(true) is None


def test_commands_that_gravity_does_not_explain_tell_nothing() -> None:
    assert told(SIDEWAYS, noise=30.0) is None
    assert told(SIDEWAYS, np.zeros(3)) is None


def test_one_joint_alone_tells_nothing() -> None:
    """A centre of mass elsewhere than the file says looks alike."""
    assert told(SIDEWAYS, moving=1) is None
    assert told(SIDEWAYS, moving=2) is not None


def test_inverted_signs_are_named_beside_it() -> None:
    found = told(DOWN, sign=-1.0)
    assert found is None or "signs of all commands may be inverted" in found.step
    upside_down = told(-DOWN)
    assert upside_down is not None
    assert "signs of all commands may be inverted" in upside_down.step


@pytest.mark.parametrize(
    ("rpy", "angle"),
    [
        ("0 0.6 0", 34),
        *(pytest.param(*own, marks=pytest.mark.slow) for own in (("0 0 1.2", 0), ("1.5708 0 0", 90))),
    ],
)
def test_a_real_log_against_a_file_whose_base_is_turned(rpy: str, angle: int, tmp_path: Path) -> None:
    """UR10 stood upright; turned about the upright axis nothing is wrong."""
    urdf = (EXAMPLES / "ur10" / "ur10.urdf").read_text()
    turn = (
        '<link name="world"/><joint name="mount" type="fixed"><parent link="world"/><child link="link_0"/>'
        f'<origin xyz="0 0 0" rpy="{rpy}"/></joint>\n</robot>'
    )
    (tmp_path / "ur10.urdf").write_text(urdf.replace("</robot>", turn))
    robot = tmp_path / "ur10.toml"
    robot.write_text((EXAMPLES / "ur10" / "ur10.toml").read_text())
    findings = inspect(EXAMPLES / "ur10" / "ur10_exciting.csv", robot).findings
    found, asked = [f for f in findings if f.check == "mounting"], {f.check for f in findings if f.flag}
    if not angle:
        assert found == []
        return
    assert angle < 60 or not asked & {"gravity", "sign", "zero"}
    told = float(found[0].sentence.partition("world, ")[2].partition(" degrees")[0])
    assert told == pytest.approx(angle, abs=2.0)
    rotation = found[0].step.partition("[mounting]")[0].removeprefix("Write ").removesuffix(" into ")
    robot.write_text(robot.read_text() + f"\n[mounting]\n{rotation}\n")
    after = inspect(EXAMPLES / "ur10" / "ur10_exciting.csv", robot).findings
    assert [f for f in after if f.check == "mounting"] == []
