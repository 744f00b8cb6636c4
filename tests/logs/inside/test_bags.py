"""ROS 2 bags: every storage, every type with joints, and every reason to refuse one with its next step."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_examples import CHANNELS, JOINTS, LIMITS, RATE

from etude.errors import DataError, UsageError
from etude.logs import read_log, read_raw
from etude.logs.readers.log_file import bytes_of_log, sha256_of_log
from etude.logs.readers.ros_messages import CONTROLLER_STATE, LATER
from etude.types import Log

pytest.importorskip("rosbags", reason="bags need the extra 'ros'")
import bag_examples as bags

LOG = bags.LOG


def read(path: Path, *topics: str) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS, topics=topics)


def assert_right(log: Log) -> None:
    np.testing.assert_allclose(log.t, LOG.t, atol=2e-9)
    np.testing.assert_array_equal(log["q"], LOG["q"])
    np.testing.assert_array_equal(log["command"], LOG["command"])


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("compression", ["", "FILE", "MESSAGE", "STORAGE"])
def test_every_storage_is_read(plugin: str, compression: str, tmp_path: Path) -> None:
    if plugin == "SQLITE3" and compression == "STORAGE":
        pytest.skip("only MCAP compresses within its storage")
    folder = bags.write_bag(tmp_path / "run", bags.joint_states(), plugin, compression)
    assert_right(read(folder))
    assert_right(read(bags.storage(folder)))
    (folder / "metadata.yaml").unlink()  # the recorder was killed
    assert_right(read(folder))


@pytest.mark.parametrize(
    "messages", [bags.controller_states, bags.dynamic_states, bags.arm_states], ids=lambda f: f.__name__
)
@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_every_type_that_holds_joints(messages: bags.Messages, plugin: str, tmp_path: Path) -> None:
    log = read(bags.write_bag(tmp_path / "run", messages(), plugin))
    assert_right(log)
    if messages is bags.controller_states:
        np.testing.assert_array_equal(log["q_des"], LOG["command"])  # the example's wanted positions


def test_types_are_known_without_definitions_in_the_bag(tmp_path: Path) -> None:
    """As ROS 2 Humble and older record with SQLite."""
    for messages in (bags.joint_states, bags.controller_states, bags.dynamic_states):
        folder = bags.write_bag(tmp_path / messages.__name__, messages(), version=8)
        assert_right(read(_without_definitions(folder)))


def _without_definitions(folder: Path) -> Path:
    with sqlite3.connect(bags.storage(folder)) as database:
        database.execute("DELETE FROM message_definitions")
    return folder


def test_an_unknown_type_is_named(tmp_path: Path) -> None:
    folder = _without_definitions(bags.write_bag(tmp_path / "run", bags.arm_states()))
    with pytest.raises(DataError, match=r"no topic with joint states.*/arm_state \(lab_msgs/msg/ArmState\)"):
        read(folder)
    with pytest.raises(DataError, match=r"type lab_msgs/msg/ArmState of topic /arm_state is not known.*MCAP"):
        read(folder, "/arm_state")


def test_a_topic_that_is_not_there_lists_those_that_are(tmp_path: Path) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())
    with pytest.raises(DataError, match=r"no topic /joint_state\b.*/joint_states \(sensor_msgs"):
        read(folder, "/joint_state")


def test_effort_in_another_topic_is_joined_by_time(tmp_path: Path) -> None:
    """The wanted positions come from the controller's topic, all else from the joint states."""
    messages = [*bags.joint_states(), *bags.controller_states()[::4]]
    folder = bags.write_bag(tmp_path / "run", sorted(messages, key=lambda m: m[2]))
    log = read(folder)
    assert len(LOG) - len(log) < 4  # the last rows lack a wanted position
    np.testing.assert_array_equal(log["q"], LOG["q"][: len(log)])
    np.testing.assert_allclose(log["q_des"][::4], LOG["command"][: len(log) : 4], atol=1e-12)
    assert any("Topics /joint_states, /controller/state were joined" in s for s in log.repairs)


def test_joint_states_without_effort_are_refused_as_such(tmp_path: Path) -> None:
    messages = [
        (
            "/joint_states",
            "sensor_msgs/msg/JointState",
            bags.nanoseconds(t),
            bags.joint_state(k, t=t, effort=False),
        )
        for k, t in enumerate(LOG.t.tolist())
    ]
    folder = bags.write_bag(tmp_path / "run", messages)
    with pytest.raises(
        DataError, match=r"no column for channel 'command'.*/joint_states was read.*no effort"
    ):
        read(folder)


def test_the_metadata_of_a_bag_is_not_the_log(tmp_path: Path) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())
    with pytest.raises(DataError, match=r"belongs to a bag.*the folder"):
        read(folder / "metadata.yaml")


def test_two_robots_are_asked_about(tmp_path: Path) -> None:
    other = tuple(f"left_{joint}" for joint in JOINTS)
    messages = [
        *bags.joint_states("/right/joint_states"),
        *bags.joint_states("/left/joint_states", names=other),
    ]
    folder = bags.write_bag(tmp_path / "run", sorted(messages, key=lambda m: m[2]))
    with pytest.raises(DataError, match=r"two robots.*/right/joint_states \(.*--topic /left/joint_states"):
        read(folder)
    assert_right(read(folder, "/right/joint_states"))
    with pytest.raises(DataError, match="no column for channel 'q'"):
        read(folder, "/left/joint_states")


def test_a_topic_without_joints_is_read_field_by_field(tmp_path: Path) -> None:
    kind = "geometry_msgs/msg/WrenchStamped"
    vector = "geometry_msgs/msg/Vector3"
    messages = [
        (
            "/wrench",
            kind,
            bags.nanoseconds(t),
            bags.made(
                kind,
                header=bags.header(t),
                wrench=bags.made(
                    "geometry_msgs/msg/Wrench",
                    force=bags.made(vector, x=t, y=2.0, z=3.0),
                    torque=bags.made(vector, x=0.0, y=0.0, z=0.0),
                ),
            ),
        )
        for t in (0.0, 0.5, 1.0)
    ]
    raw = read_raw(bags.write_bag(tmp_path / "run", messages), ("/wrench",))
    np.testing.assert_array_equal(raw["wrench.force.x"][:, 0], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(raw.t, [0.0, 0.5, 1.0])


def test_stamps_that_do_not_move_give_way_to_the_recorder(tmp_path: Path) -> None:
    start = bags.header(0.0)
    stuck = [(name, kind, ns, replace(m, header=start)) for name, kind, ns, m in bags.joint_states()]
    log = read(bags.write_bag(tmp_path / "run", stuck))
    assert_right(log)
    assert "Times are those of recording." in log.repairs


def test_an_mcap_that_was_cut_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states(), "MCAP")
    path = bags.storage(folder)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    for place in (path, folder):  # by itself, and beside the metadata of the whole
        log = read(place)
        assert 0.3 < len(log) / len(LOG) < 0.7
        np.testing.assert_array_equal(log["q"], LOG["q"][: len(log)])
        cut = next(sentence for sentence in log.repairs if "The bag was cut" in sentence)
        assert cut.endswith(f"{np.ptp(log.t):.3g} s of it remain.")


def test_a_bag_that_was_cut_before_its_topics_says_so(tmp_path: Path) -> None:
    """One packed chunk, of which nothing can be unpacked: joint states were there, but nobody can tell."""
    folder = bags.write_bag(tmp_path / "run", bags.joint_states(), "MCAP", "STORAGE")
    path = bags.storage(folder)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match=r"no topic with joint states\. The bag was cut"):
        read(path)


def test_a_sqlite_bag_that_was_cut_is_refused_or_read_in_part(tmp_path: Path) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())
    path = bags.storage(folder)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match=r"the bag cannot be read.*truncated, damaged"):
        read(folder)


def test_a_message_without_a_time_is_refused(tmp_path: Path) -> None:
    """A damaged cell of SQLite may be empty, or text."""
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())
    with contextlib.closing(sqlite3.connect(bags.storage(folder))) as storage, storage:
        storage.execute("UPDATE messages SET timestamp = 'x' WHERE id = 5")
    with pytest.raises(DataError, match="holds no data, or no time"):
        read(folder)


def test_a_folder_that_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="this is a folder, not a log file"):
        read(tmp_path)


def test_the_hash_of_a_bag_is_of_its_files(tmp_path: Path) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())
    before = sha256_of_log(folder)
    copy = shutil.copytree(folder, tmp_path / "copy")
    (copy / "notes.txt").write_text("mine")
    assert sha256_of_log(copy) == before
    sizes = [one.stat().st_size for one in folder.iterdir()]
    assert bytes_of_log(copy) == sum(sizes)
    assert bytes_of_log(bags.storage(folder)) in sizes
    with (copy / "metadata.yaml").open("a") as file:
        file.write("\n")
    assert sha256_of_log(copy) != before
    with pytest.raises(DataError, match="no such log"):
        sha256_of_log(tmp_path / "gone")


def test_without_the_library_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = bags.write_bag(tmp_path / "run", bags.joint_states())

    def gone(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr("etude.logs.readers.extras.importlib.import_module", gone)
    with pytest.raises(UsageError, match=r"reading this log needs rosbags.* pip install 'rosbags>=0.10.9'"):
        bags_reader(folder)


def bags_reader(folder: Path) -> None:
    from etude.logs.readers.bags import read_bag

    read_bag(folder)


def controllers(folder: Path, definition: str, also: list[bags.Message]) -> Path:
    """An SQLite bag with the states of a controller of another release, as old recorders write it."""
    states, store = bags.later_states(definition)
    every = sorted([*states, *also], key=lambda message: message[2])
    return bags.without_definitions(bags.write_bag(folder, every, version=8, store=store))


def test_a_controller_of_humble_is_read_without_a_definition(tmp_path: Path) -> None:
    assert_right(read(controllers(tmp_path / "run", LATER[CONTROLLER_STATE], [])))


def test_a_topic_that_nobody_can_read_does_not_spoil_the_joint_states(tmp_path: Path) -> None:
    unheard = "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint output\n"
    path = controllers(tmp_path / "run", unheard, bags.joint_states())
    log = read(path)
    assert_right(log)
    assert any(s.startswith("Topic /controller/state was ignored: ") for s in log.repairs)
    with pytest.raises(DataError, match="another release of ROS"):
        read(path, "/controller/state")


@pytest.mark.parametrize("faster", [1, 3])
def test_a_gripper_of_its_own_driver_on_the_same_topic(faster: int, tmp_path: Path) -> None:
    """Each message names the joints of one driver only."""
    arm = bags.joint_states()
    times = np.arange(faster * len(LOG)) * (LOG.t[1] / faster) + 0.003
    fingers = [
        ("/joint_states", "sensor_msgs/msg/JointState", bags.nanoseconds(t), bags.finger(float(t)))
        for t in times
    ]
    log = read(bags.write_bag(tmp_path / "run", sorted([*arm, *fingers], key=lambda m: m[2])))
    assert any("joined by time" in sentence for sentence in log.repairs)
    t = log.t + (0.0 if faster == 1 else 0.003)  # by the arm's clock: the faster one leads
    expected = np.stack([np.interp(t, LOG.t, column) for column in LOG["q"].T], axis=1)
    np.testing.assert_allclose(log["q"], expected, atol=1e-6)
