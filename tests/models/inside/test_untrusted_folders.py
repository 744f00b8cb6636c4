"""A folder that somebody sends runs no code: names in its files count where this user made it, or said so."""

from __future__ import annotations

import contextlib
import json
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude import cli, plugins
from etude.campaign import create_campaign, open_campaign
from etude.errors import EtudeError, UsageError
from etude.models import SquaredExponential, store
from etude.toml_tables import toml_value

CANARY = "canary_in_the_folder"
CODE = """
import pathlib
pathlib.Path(__file__).with_suffix(".ran").touch()
def run(output, batch, gain):
    return None
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A campaign of this user's; what its canary names can be imported, and leaves a file when it is."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / f"{CANARY}.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(plugins, "_typed_names", set())
    yield create_campaign(tmp_path / "mine", "arm4")[0].path  # type: ignore[misc]
    sys.modules.pop(CANARY, None)


def ran(folder: Path) -> bool:
    return (folder / f"{CANARY}.ran").exists()


def set_key(folder: Path, section: str, key: str, value: str) -> None:
    path = folder / "campaign.toml"
    lines, inside = path.read_text().splitlines(), section == ""
    for i, line in enumerate(lines):
        inside = line == f"[{section}]" if line.startswith("[") else inside
        if inside and line.startswith(f"{key} ="):
            lines[i] = f"{key} = {value}"
            path.write_text("\n".join(lines) + "\n")
            return
    raise AssertionError(f"no {key} in [{section}]")


PLACES = (("model", "kernel"), ("model", "process"), ("design", "criterion"), ("", "kind"))


@pytest.mark.parametrize(("section", "key"), PLACES)
def test_a_copy_names_code_in_vain(
    mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], section: str, key: str
) -> None:
    strange = Path(shutil.copytree(mine, tmp_path / "strange"))
    set_key(strange, section, key, '"os:system"')
    for command in ("status", "ask", "predict"):
        more = [str(tmp_path / "x.csv")] if command == "predict" else []
        assert cli.main([command, str(strange), *more]) == 2
        words = capsys.readouterr().err
        assert "os:system" in words
        assert "os.py" in words  # from where
        assert f"as {f'{section}.{key}'.strip('.')}" in words
        assert f"etude status {strange} --trust" in words


def test_every_text_of_every_file_of_a_strangers_is_in_vain(mine: Path, tmp_path: Path) -> None:
    """Whatever key it stands at, nothing is imported, by whatever is done with the folder."""
    for file in ("campaign.toml", "robot.toml"):
        table = tomllib.loads((mine / file).read_text())
        for place in _texts(table):
            strange = Path(shutil.copytree(mine, tmp_path / "strange"))
            (strange / file).write_text(_toml(_put(table, place, f"{CANARY}:run")))
            for _ in range(2):
                with contextlib.suppress(EtudeError):
                    open_campaign(strange).limits()
            assert not ran(tmp_path), f"{file}: {place}"
            shutil.rmtree(strange)


def _texts(value: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    if isinstance(value, str):
        return [place]
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [one for key, item in items for one in _texts(item, (*place, key))]


def _put(value: Any, place: tuple[Any, ...], new: str) -> Any:
    if not place:
        return new
    if isinstance(value, dict):
        return {k: _put(v, place[1:], new) if k == place[0] else v for k, v in value.items()}
    return [_put(v, place[1:], new) if k == place[0] else v for k, v in enumerate(value)]


def _toml(table: dict[str, Any]) -> str:
    plain = {k: v for k, v in table.items() if not isinstance(v, dict)}
    lines = [f"{k} = {toml_value(v)}" for k, v in plain.items()]
    for name, own in table.items():
        if isinstance(own, dict):
            lines += [f"[{name}]", *(f"{json.dumps(k)} = {toml_value(v)}" for k, v in own.items())]
    return "\n".join(lines) + "\n"


def test_a_folder_of_ones_own_names_it_until_it_is_copied(mine: Path, tmp_path: Path) -> None:
    set_key(mine, "design", "criterion", f'"{CANARY}:run"')
    assert open_campaign(mine).config.design.criterion == f"{CANARY}:run"
    copy = Path(shutil.copytree(mine, tmp_path / "copy"))
    with pytest.raises(UsageError, match=f"{CANARY}:run"):
        open_campaign(copy)
    moved = Path(shutil.move(mine, tmp_path / "moved"))
    with pytest.raises(UsageError, match=f"{CANARY}:run"):
        open_campaign(moved)


def test_trust_is_one_command_and_this_users(
    mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(mine, tmp_path / "copy"))
    set_key(copy, "design", "criterion", f'"{CANARY}:run"')
    assert cli.main(["status", str(copy)]) == 2
    assert cli.main(["status", str(copy), "--trust"]) == 0
    assert cli.main(["status", str(copy)]) == 0
    assert "is trusted from now on" in capsys.readouterr().err
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "another"))
    assert cli.main(["status", str(copy)]) == 2
    assert not ran(tmp_path)


def test_what_took_its_place_is_another_folder(mine: Path) -> None:
    shutil.rmtree(mine)
    create_campaign(mine.parent / "other", "arm4", seed=9)
    shutil.move(mine.parent / "other", mine)
    set_key(mine, "design", "criterion", f'"{CANARY}:run"')
    with pytest.raises(UsageError, match=f"{CANARY}:run"):
        open_campaign(mine)


def test_where_no_list_can_be_kept_a_campaign_is_made_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "config").write_text("a file")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    assert open_campaign(create_campaign(tmp_path / "lab", "arm4")[0].path).name == "arm4"


def test_a_model_of_a_strangers_names_code_in_vain(mine: Path, tmp_path: Path) -> None:
    """Its kernel's name stands in the file of the model; a whole journal beside it changes nothing."""
    words = {"type": "plugin", "name": f"{CANARY}:run", "columns": [], "commands": []}
    from etude.models import kernel_of

    with plugins.named_in(tmp_path / "model.npz", tmp_path, "", "etude status x --trust"):
        with pytest.raises(UsageError, match=f"{CANARY}:run"):
            kernel_of(words)
        with pytest.raises(UsageError, match=f"{CANARY}:run"):
            plugins.load("etude.models", f"{CANARY}:run")
        assert kernel_of({"type": "SquaredExponential", "dims": [0], "unit": False, "share": 1.0})
    assert not ran(tmp_path)


WRONG = {
    "etude.kernels": ("os:system", "json:dumps", "os:sep"),
    "etude.models": ("os:system", "json:dumps"),
    "etude.criteria": ("os:system", "etude.design.criteria:LOG_FLOOR"),
    "etude.exporters": ("os:system", "json:dumps"),
    "etude.readers": ("os:sep", "os:getpid"),
    "etude.targets": ("os:system",),
    "etude.robots": ("os:system", "os:sep", "json:JSONDecoder"),
}


@pytest.mark.parametrize(("group", "name"), [(g, n) for g, own in WRONG.items() for n in own])
def test_a_thing_of_another_kind_is_refused_before_it_is_called(group: str, name: str) -> None:
    """What is typed is trusted, and is still no kernel."""
    with pytest.raises(UsageError, match=f"{name} is not a"):
        plugins.load(group, name)


def test_what_comes_with_it_is_of_the_kind_that_its_group_says() -> None:
    for group in plugins.SHAPES:
        for name, target in plugins.BUILT_IN[group].items():
            assert plugins.load(group, target) is plugins.load(group, name)


def test_arrays_of_a_strangers_hold_no_objects(tmp_path: Path) -> None:
    """No file of a campaign is unpickled."""
    np.savez(tmp_path / "m.npz", words=np.array([SquaredExponential((0,), False, 1.0)], dtype=object))
    with pytest.raises(EtudeError, match="not a readable model"):
        store.load_model(tmp_path / "m.npz", lambda _: None, {})  # type: ignore[arg-type, return-value]
