"""Drivers by name: what a person types is trusted, what stands in a file is not, and errors help."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.drivers import Player, Streamed, find_driver
from etude.errors import UsageError
from etude.plugins import named_in

FILE = """
from etude.testing import FakeRobot
from pathlib import Path
Path(__file__ + ".ran").touch()

def factory(joints, address, settings):
    robot = FakeRobot(joints)
    robot.address, robot.settings = address, settings
    return robot

def nothing(joints, address, settings):
    return object()

def broken(joints, address, settings):
    raise OSError("no such port")

def wrong():
    pass
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "my_arm.py").write_text(FILE)
    return tmp_path / "my_arm.py"


def test_a_file_names_a_factory_and_a_stream_becomes_a_player(file: Path) -> None:
    player = find_driver(f"{file}:factory:/dev/arm", ("waist",), {"rate": 3})
    assert isinstance(player, Player)
    assert isinstance(player, Streamed)
    assert player.about().joints == ("waist",)
    assert (player.stream.address, player.stream.settings) == ("/dev/arm", {"rate": 3})  # type: ignore[attr-defined]


def test_so_does_a_module(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(file.parent)
    assert isinstance(find_driver("my_arm:factory", ("waist",)), Streamed)


@pytest.mark.parametrize(
    ("on", "words"),
    [
        ("{file}:nothing", "returned a object, which is neither a Stream nor a Player"),
        ("{file}:broken", "cannot be made: OSError: no such port"),
        ("{file}:wrong", "is not a driver's factory"),
        ("{file}:none", "the file has no none"),
        ("{file}", "needs the name of a factory"),
        ("no_such_file.py:factory", "there is no such file"),
        ("arm", "there is no driver 'arm'"),
        ("", "there is no driver ''"),
        ("no_such_module:factory", "cannot be loaded"),
    ],
)
def test_what_is_wrong_is_named(file: Path, on: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        find_driver(on.format(file=file), ("waist",))
    assert caught.value.exit_code == 2
    assert caught.value.next_step


@pytest.mark.parametrize(
    ("on", "meant"),
    [
        ("mujoko", "mujoco"),
        ("mujoko:x.urdf", "mujoco"),
        ("{file}:factori", "factory"),
        ("my_arm:factori", "factory"),
    ],
)
def test_a_misspelt_name_is_answered_with_the_nearest(
    file: Path, monkeypatch: pytest.MonkeyPatch, on: str, meant: str
) -> None:
    """Nobody is told to install a package whose name is a slip."""
    monkeypatch.syspath_prepend(file.parent)
    with pytest.raises(UsageError) as caught:
        find_driver(on.format(file=file), ("waist",))
    assert caught.value.next_step.startswith(f"Did you mean {meant}? ")
    assert "nstall" not in caught.value.next_step


def test_a_name_in_a_file_is_not_run_in_a_folder_that_nobody_trusts(file: Path) -> None:
    run = file.parent / "run.toml"
    with (
        named_in(run, file.parent, "somebody's", "etude status --trust"),
        pytest.raises(UsageError, match="code that would be imported and run"),
    ):
        find_driver(f"{file}:factory", ("waist",))
    assert not Path(f"{file}.ran").exists()
    with named_in(run, file.parent, "somebody's", "etude status --trust"), pytest.raises(UsageError):
        find_driver("another_arm:factory", ("waist",))
