"""The driver `mujoco`: a model as a robot, on a clock of its own and in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.drivers import Bounds, Ended, Player, Recording, Streamed, Supervisor, find_driver, planned
from etude.errors import UsageError
from etude.trajectories import PointToPoint
from etude.types import Array
from etude_drivers import Machine, MachineSettings, MujocoRobot

UR10 = Path(__file__).parents[2] / "examples" / "ur10" / "ur10.urdf"
JOINTS = tuple(
    f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)


def play(
    player: Player, way: float, joints: tuple[str, ...] = JOINTS, effort: Array | None = None
) -> Recording:
    """Of all joints from where they stand and back."""
    about, start = player.about(), player.where().asked
    assert start is not None
    there = np.array([start, start + way, start])
    own = PointToPoint(there, peak_velocity=1.0, dwell=0.1, peak_acceleration=4.0)
    held = None if effort is None else lambda motion: np.tile(effort, (len(motion.t), 1))
    motion = planned(
        own.to_json().encode(),
        number=1,
        part="motion",
        speed=100,
        names=joints,
        joints=about.joints,
        rate=about.rate,
        effort=held,
    )
    ones = np.ones(len(joints))
    bounds = Bounds(error=0.2 * ones, lower=-6 * ones, upper=6 * ones, velocity=5 * ones)
    supervisor = Supervisor(bounds, about, motion)
    recording = player.play(motion, supervisor.watch, "feedback" if effort is None else "learned")
    assert not supervisor.reason
    return recording


def simulated(settings: Mapping[str, Any] | None = None) -> Player:
    return find_driver(f"mujoco:{UR10},virtual", JOINTS, settings)


def error(recording: Recording) -> float:
    return float(np.abs(recording.q - recording.asked).mean())


def at_the_end(recording: Recording) -> float:
    return float(np.abs(recording.q[-1] - recording.asked[-1]).max())


def test_a_urdf_without_its_meshes_plays_a_motion() -> None:
    with simulated() as player:
        recording = play(player, 0.5)
        again = play(player, 0.5)
    assert recording.ended is Ended.DONE
    assert 1e-4 < error(recording) < 0.02
    assert recording.late == 0
    assert again.t[0] >= recording.t[-1]
    assert np.abs(recording.command).max() > 50.0, "it holds its weight"


def test_the_same_settings_give_the_same_robot_and_wrong_masses_another() -> None:
    def once(settings: Mapping[str, Any]) -> Recording:
        with simulated(settings) as player:
            return play(player, 0.2)

    same = once({}), once({})
    np.testing.assert_array_equal(same[0].q, same[1].q)
    other = once({"wrong_masses": 0.1})
    assert np.abs(other.command[:50] - same[0].command[:50]).max() > 1.0


def test_a_robot_that_nobody_places_begins_at_home() -> None:
    home = {name: 0.2 * (i - 2) for i, name in enumerate(JOINTS)}
    for settings, elbow in (({}, home["elbow_joint"]), ({"start": {"elbow_joint": 0.9}}, 0.9)):
        where = find_driver(f"mujoco:{UR10},virtual", JOINTS, settings, home=home).where()
        assert where.asked is not None
        assert where.asked[2] == pytest.approx(elbow)


def test_it_settles_once_and_about_the_place_where_it_was_put(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles: list[float] = []
    cycle = Machine.cycle
    monkeypatch.setattr(Machine, "cycle", lambda own: (cycles.append(own.t), cycle(own))[1])
    robot = find_driver(f"mujoco:{UR10},virtual", JOINTS, {}, home=dict.fromkeys(JOINTS, 0.3))
    assert robot.about().joints == JOINTS
    assert not cycles, "nobody has connected yet"
    with robot:
        sample = robot.where()
    assert len(cycles) == 250, "a second"
    assert sample.t == 0.0
    assert np.abs(sample.q - 0.3).max() < 0.02


def test_stiction_is_friction_that_speed_takes_away() -> None:
    """At speeds far below and far above that of Stribeck, through the pose where the arm hangs."""

    def friction(speed: float, stiction: float) -> float:
        own = MachineSettings(model=str(UR10), friction=0.5, viscous=0.0, stiction=stiction, noise=0.0)
        commands = []
        for way in (1.0, -1.0):
            machine, joint = Machine(("wrist_3_joint",), own), np.zeros(1)
            for cycle in range(200):
                machine.ask(joint + way * speed * cycle * machine.period, joint + way * speed, joint, None)
                machine.cycle()
            commands.append(float(machine.command[0]))
        return 0.5 * (commands[0] - commands[1])

    slow, fast = (friction(v, 0.5) / friction(v, 0.0) for v in (0.002, 0.5))
    assert slow == pytest.approx(1.5, rel=0.03), "the solver of MuJoCo softens friction"
    assert fast == pytest.approx(1.0, rel=0.03)


def test_effort_is_added_to_feedback() -> None:
    """What it takes to hold the pose, fed forward, takes gravity's error away."""
    with simulated({"friction": 0.0}) as player:
        sag = play(player, 0.001)
        held = play(player, 0.001, effort=sag.command.mean(axis=0))
    assert at_the_end(held) < 0.1 * at_the_end(sag)


def test_a_robot_that_adds_gravity_has_commands_without_it() -> None:
    with simulated({"adds_gravity": True}) as player:
        assert player.about().gravity_in_command is False
        recording = play(player, 0.01)
    assert np.abs(recording.command[-1]).max() < 15.0


def test_joints_that_are_not_the_campaigns_are_held_and_go_by_name() -> None:
    joints = ("elbow_joint", "shoulder_lift_joint")
    with find_driver(f"mujoco:{UR10},virtual", joints, {"start": {"elbow_joint": 0.4}}) as player:
        assert player.about().joints == joints
        np.testing.assert_allclose(player.where().q, [0.4, 0.0], atol=0.03)
        assert play(player, 0.1, joints).ended is Ended.DONE


def test_after_a_stop_it_brakes_holds_and_follows_nothing_until_it_is_ready() -> None:
    """Without another set-point each joint goes on by half of what its speed makes in 0.2 s."""
    ones, still = np.ones(len(JOINTS)), np.zeros(len(JOINTS))
    with simulated({"rate": 500.0}) as player:
        assert isinstance(player, Streamed)
        robot = player.stream
        start = player.where().asked
        assert start is not None
        robot.ready("feedback")
        for cycle in range(1, 101):
            robot.send(start + 0.5 * cycle / 500.0 * ones, 0.5 * ones, still, None)
        last = robot.state()
        robot.stop()
        after = robot.state()
        assert last.asked is not None
        assert after.asked is not None
        assert after.qd is not None
        np.testing.assert_allclose(after.asked - last.asked, 0.5 * 0.5 * 0.2, atol=1e-9)
        assert np.all(after.q > last.q)
        assert np.abs(after.qd).max() < 3e-3
        assert after.t - last.t <= player.about().stopping_time
        robot.send(start, still, still, None)
        np.testing.assert_array_equal(robot.state().asked, after.asked)
        robot.ready("feedback")
        robot.send(start, still, still, None)
        np.testing.assert_allclose(robot.state().asked, start, atol=1e-9)


def test_in_its_own_process_it_is_a_robot_in_real_time() -> None:
    with find_driver(f"mujoco:{UR10}", JOINTS) as player:
        recording = play(player, 0.05)
        assert recording.ended is Ended.DONE
        assert error(recording) < 0.02


@pytest.mark.parametrize(
    ("on", "settings", "words"),
    [
        ("mujoco", {}, "there is no such model"),
        ("mujoco:nowhere.urdf", {}, "there is no such model"),
        (f"mujoco:{UR10}", {"colour": 1}, r"no key colour for mujoco"),
        (f"mujoco:{UR10}", {"start": {"knee": 1.0}}, "start names 'knee'"),
        (f"mujoco:{UR10}", {"rate": -1.0}, "rate and bandwidth have to be positive"),
    ],
)
def test_what_is_wrong_is_said_before_anything_starts(on: str, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        find_driver(on, JOINTS, settings)


def test_a_joint_that_the_model_lacks_is_named() -> None:
    with pytest.raises(UsageError, match="the model has no joint knee") as found:
        find_driver(f"mujoco:{UR10},virtual", ("knee",))
    assert all(joint in found.value.next_step for joint in JOINTS)


@pytest.mark.parametrize(
    "file",
    [
        "kinova_description/robots/kinova.urdf",
        "z1_description/urdf/z1.urdf",
        "tiago_description/robots/tiago.urdf",
    ],
)
def test_robots_of_others_are_stable(file: str) -> None:
    """With light wrists, with friction in the file, and with moments of inertia that no body has."""
    try:
        files = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")
    path = Path(str(files.locate_file(f"cmeel.prefix/share/example-robot-data/robots/{file}")))
    joints = tuple(
        joint.get("name", "")
        for joint in ElementTree.parse(path).getroot().iter("joint")
        if joint.get("type") == "revolute" and joint.find("mimic") is None
    )[:6]
    with find_driver(f"mujoco:{path},virtual", joints, {"wrong_masses": 0.1}) as player:
        recording = play(player, 0.1, joints)
    assert recording.qd is not None
    assert np.abs(recording.qd[-1]).max() < 0.01
    assert error(recording) < 0.02


def test_where_it_is_is_fresh_after_a_pause() -> None:
    """The robot goes on meanwhile, and samples that were not taken are old."""
    with find_driver(f"mujoco:{UR10}", JOINTS, {"rate": 1000.0}) as player:
        before, began = player.where().t, time.monotonic()
        time.sleep(1.0)
        passed = player.where().t - before
        assert passed > 0.5 * (time.monotonic() - began), "a busy machine slows the robot down, not to half"


def test_a_robot_that_dies_is_a_lost_link() -> None:
    """Its process is killed in mid-motion."""
    with find_driver(f"mujoco:{UR10}", JOINTS) as player:
        assert isinstance(player, Streamed)
        robot = player.stream
        assert isinstance(robot, MujocoRobot)
        assert robot.process is not None
        threading.Timer(0.8, robot.process.kill).start()
        recording = play(player, 0.5)
    assert recording.ended is Ended.LOST
    assert 0.0 <= recording.reached < recording.motion.duration


CLIENT = """
from etude.drivers import find_driver
with find_driver({on!r}, {joints!r}) as player:
    print(player.stream.process.pid, flush=True)
    player.where()
    while True:
        player.where()
"""


def test_the_robot_ends_by_itself_when_its_master_is_killed() -> None:
    code = CLIENT.format(on=f"mujoco:{UR10}", joints=JOINTS)
    client = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert client.stdout is not None
    robot = int(client.stdout.readline())
    client.kill()
    client.communicate()
    for _ in range(200):
        if not Path(f"/proc/{robot}").exists() or "Z" in Path(f"/proc/{robot}/stat").read_text().split()[2]:
            return
        time.sleep(0.1)
    raise AssertionError("the process of the robot is still there")


def test_a_link_called_world_keeps_the_joint_that_mounts_it(tmp_path: Path) -> None:
    """MuJoCo's own fixed body has that name: the tilt of such a link was lost, and the weight with it."""

    def weight(name: str) -> float:
        urdf = f"""<robot name="r"><link name="wall"/><link name="{name}"/>
        <joint name="bolts" type="fixed"><parent link="wall"/><child link="{name}"/>
        <origin rpy="1.5707963 0 0"/></joint>
        <link name="arm"><inertial><mass value="2"/><origin xyz="0.5 0 0"/>
        <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="{name}"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="50" velocity="2"/></joint></robot>"""
        file = tmp_path / f"{name}.urdf"
        file.write_text(urdf)
        machine = Machine(("j",), MachineSettings(model=str(file), start={"j": 0.0}))
        machine.settle()
        return float(machine.command[0])

    assert weight("world") == pytest.approx(weight("base"), rel=1e-6)
    assert weight("world") == pytest.approx(2 * 9.81 * 0.5, rel=0.1)
