"""Finding a robot: by name or by file, over all kinds that there are, with words for what is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from small_robot import ROBOT

from etude import load_robot, plugins
from etude.campaign import Created, create_campaign, find_robot, open_campaign
from etude.errors import UsageError


def test_built_in_robots_of_every_kind() -> None:
    assert find_robot("arm4")[0].name == "arm"
    assert find_robot("quadrotor")[0].name == "quadrotor"
    assert load_robot("arm4_rough").name == "arm4_rough"


def test_a_file_is_recognised_by_its_kind(tmp_path: Path) -> None:
    path = tmp_path / "pair.toml"
    path.write_text(ROBOT)
    assert load_robot(path).name == "pair"
    assert find_robot(str(path))[0].name == "arm"
    flying = plugins.load("etude.robots", "quadrotor").built_in()["quadrotor"]
    assert find_robot(str(flying))[0].name == "quadrotor"


def test_what_is_no_robot_is_said(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError,
        match=r"no robot and no file 'arm5'.*Did you mean arm\S*\? Built-in",
    ):
        load_robot("arm5")
    with pytest.raises(UsageError, match=r"there is no robot and no file '.*missing\.toml'"):
        load_robot(tmp_path / "missing.toml")
    with pytest.raises(UsageError, match="this is a folder, not a robot's description"):
        load_robot(tmp_path)
    for name, content in {"a.toml": "[boat]\n", "b.toml": "kind = 'boat'", "c.txt": ROBOT, "d": ""}.items():
        (tmp_path / name).write_text(content)
        if name == "a.toml":
            continue  # without a kind it is an arm's, which then says what it lacks
        said = r"(no known kind of robot|no kind of robot 'boat' is known) \(arm, quadrotor"
        with pytest.raises(UsageError, match=said):
            load_robot(tmp_path / name)


class Boat:
    """A kind that takes every TOML file for its own."""

    name = "boat"

    def built_in(self) -> dict[str, Path]:
        return {}

    def recognises(self, path: Path) -> bool:
        return path.suffix == ".toml"


def test_several_kinds_may_recognise_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = plugins.load
    monkeypatch.setattr(plugins, "names", lambda group: ("arm", "boat"))
    monkeypatch.setattr(plugins, "load", lambda g, name: Boat() if name == "boat" else real(g, name))
    path = tmp_path / "pair.toml"
    path.write_text(ROBOT)
    with pytest.raises(UsageError, match=r"this file fits several kinds of robot: arm, boat"):
        load_robot(path)


def test_a_broken_kind_harms_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = plugins.load

    def load(group: str, name: str) -> Any:
        if name == "boat":
            raise UsageError("'boat' cannot be loaded: ModuleNotFoundError: No module named 'sea'")
        return real(group, name)

    monkeypatch.setattr(plugins, "names", lambda group: ("arm", "boat"))
    monkeypatch.setattr(plugins, "load", load)
    assert find_robot("arm4")[0].name == "arm"
    (tmp_path / "b.toml").write_text("kind = 'boat'")
    with pytest.raises(UsageError, match=r"boat cannot be used: .*No module named 'sea'"):
        load_robot(tmp_path / "b.toml")


def test_a_folder_that_is_a_campaign_is_refused_before_the_robot_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create_campaign(tmp_path / "lab", "arm4")
    before = {path: path.read_bytes() for path in (tmp_path / "lab").rglob("*") if path.is_file()}

    def read(*_: Any) -> Any:
        raise AssertionError("the robot was read")

    monkeypatch.setattr("etude.campaign.create.find_robot", read)
    with pytest.raises(UsageError, match="already holds a campaign"):
        create_campaign(tmp_path / "lab", "arm4")
    assert before == {path: path.read_bytes() for path in (tmp_path / "lab").rglob("*") if path.is_file()}
    with pytest.raises(AssertionError, match="was read"):
        create_campaign(tmp_path / "other", "arm4")


@pytest.mark.parametrize("name", ["robot.toml", "campaign.toml"])
def test_init_overwrites_no_file_of_a_person(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("# mine\n")
    with pytest.raises(UsageError, match=f"this folder holds another {name}"):
        create_campaign(tmp_path, "arm4")
    assert {path.name: path.read_text() for path in tmp_path.glob("*.toml")} == {name: "# mine\n"}


@pytest.mark.parametrize("left", [None, b"", b"no event"])
def test_a_lost_journal_sends_nobody_to_init(tmp_path: Path, left: bytes | None) -> None:
    campaign, _ = create_campaign(tmp_path / "lab", "arm4")
    (campaign.path / "proposals" / "0001").mkdir(parents=True)
    journal = campaign.path / "journal.jsonl"
    journal.unlink() if left is None else journal.write_bytes(left)
    before = {path: path.read_bytes() for path in campaign.path.rglob("*") if path.is_file()}
    for again in (lambda: open_campaign(campaign.path), lambda: create_campaign(campaign.path, "quadrotor")):
        with pytest.raises(UsageError, match=r"journal of this campaign is lost.*proposals.*from a copy"):
            again()
    assert before == {path: path.read_bytes() for path in campaign.path.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b'kind = "arm\n', r"not valid TOML: .*line 1"),
        ('kind = "arm"\n'.encode("utf-16"), "cannot be read.*UTF-8"),
        (b'kind = "legged"\n', "no kind of robot 'legged' is known"),
    ],
)
def test_a_robot_file_that_cannot_be_read_says_why(tmp_path: Path, data: bytes, fault: str) -> None:
    (tmp_path / "robot.toml").write_bytes(data)
    with pytest.raises(UsageError, match=fault):
        load_robot(tmp_path / "robot.toml")


def test_a_robot_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    text = (create_campaign(tmp_path / "lab", "arm4")[0].path / "robot.toml").read_bytes()
    (tmp_path / "lab" / "marked.toml").write_bytes(b"\xef\xbb\xbf" + text)
    assert load_robot(tmp_path / "lab" / "marked.toml").names == load_robot("arm4").names


def test_the_folder_says_what_it_is(tmp_path: Path) -> None:
    campaign, _ = create_campaign(tmp_path / "lab", "quadrotor", seed=2)
    axes = ("x", "y", "z")
    assert campaign.events()[0].fact == Created(
        seed=2, preset="default", kind="quadrotor", robot="quadrotor", axes=axes
    )
    assert 'kind = "quadrotor"' in (campaign.path / "campaign.toml").read_text()
    assert (campaign.name, campaign.command.units[0]) == ("quadrotor", "V")
