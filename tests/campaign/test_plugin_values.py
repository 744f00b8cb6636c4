"""Kinds that return another value than their protocol says are named, and nothing is written."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from small_robot import ROBOT

from etude import cli, plugins

KIND = """
import numpy as np
from etude_arm.kind import ArmKind

class Legged(ArmKind):
    name = "legged"
    def built_in(self):
        return {{}}
    def recognises(self, path):
        return path.suffix == ".legg"
    def described(self, path):
        from etude.types import Described
        return Described({{"robot.toml": path.read_bytes()}})
{more}

KIND = Legged()
"""
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """A command with a kind "legged", that has these lines more, installed: its code, stdout and stderr."""
    info = tmp_path / "legs-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: legs\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("[etude.robots]\nlegged = legs_module:KIND\n")
    (tmp_path / "dog.legg").write_text(ROBOT)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(plugins, "_failures", {})
    monkeypatch.setattr(plugins, "_places", {})

    def run(more: str, command: str, *given: str) -> tuple[int, str, str]:
        lines = "\n".join(f"    {line}" for line in more.splitlines())
        (tmp_path / "legs_module.py").write_text(KIND.format(more=lines))
        sys.modules.pop("legs_module", None)
        plugins._installed.cache_clear()
        code = cli.main([command, str(tmp_path / "lab"), *given])
        said = capsys.readouterr()
        return code, said.out, " ".join(said.err.split())

    yield run  # type: ignore[misc]
    plugins._installed.cache_clear()
    sys.modules.pop("legs_module", None)


def made(run: Run, tmp_path: Path, more: str = "") -> tuple[int, str, str]:
    return run(more, "init", "--robot", str(tmp_path / "dog.legg"))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("described = lambda self, path: None", "described of the kind of robot legged returned None"),
        (
            "spec = lambda self, path: None",
            "returned None, without the name, rate of a Description",
        ),
        ("channels = lambda self, spec: None", "channels of the kind of robot legged returned None"),
        ("tables = {'trajectory': dict}", "tables of the kind of robot legged is {"),
        ("presets = {'foo': {}}", "without default, thesis"),
        ("recognises = lambda self, path: 'yes'", "returned 'yes', not True or False"),
        ("from_rest = None", "from_rest of the kind of robot legged is None, not a method"),
        ("states_in_words = None", "states_in_words of the kind of robot legged is None, not a text"),
        ("def spec(self, path): raise OSError('disk\\ngone')", "legs_module:KIND raised OSError: disk gone"),
    ],
)
def test_init_names_the_kind_and_leaves_nothing(run: Run, tmp_path: Path, more: str, said: str) -> None:
    code, out, err = made(run, tmp_path, more)
    assert (code, out) == (2, "")
    assert said in err
    assert "Traceback" not in err
    assert not (tmp_path / "lab").exists()


def test_a_kind_that_cannot_be_asked_is_named_where_no_other_takes_the_file(run: Run, tmp_path: Path) -> None:
    _, _, err = made(run, tmp_path, "recognises = lambda self, path: 1 / 0")
    assert "legged cannot be used: ZeroDivisionError: division by zero." in err
    assert not (tmp_path / "lab").exists()


@pytest.mark.parametrize("more", ["recognises = lambda self, path: 1 / 0", "built_in = lambda self: 1 / 0"])
def test_a_kind_that_fails_harms_no_other_robot(run: Run, tmp_path: Path, more: str) -> None:
    (tmp_path / "own.toml").write_text(ROBOT)
    assert run(more, "init", "--robot", str(tmp_path / "own.toml"))[0] == 0


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("home = lambda self, spec: np.zeros(7)", "an array of shape (7,), not of shape (k,), k = 2"),
        ("home = lambda self, spec: np.full(2, 99.0)", "home of the kind of robot legged is outside"),
        ("limit = lambda self, spec: np.full(2, np.nan)", "not finite"),
        ("limits = lambda self, *given: None", "limits of the kind of robot legged returned None"),
        ("limits = lambda self, *given: [5]", "returned 5, without the name"),
        ("largest_error = lambda self, spec: np.zeros(7)", "largest_error of the kind of robot legged"),
        ("def reachable(self, spec): raise ValueError('reach!')", "raised ValueError: reach!"),
    ],
)
def test_ask_names_the_kind_and_commits_nothing(run: Run, tmp_path: Path, more: str, said: str) -> None:
    assert made(run, tmp_path)[0] == 0
    before = (tmp_path / "lab" / "journal.jsonl").read_bytes()
    code, out, err = run(more, "ask", "--json")
    assert code == 2
    assert said in err
    assert "Traceback" not in err
    assert json.loads(out)["error"]["exit_code"] == 2
    assert (tmp_path / "lab" / "journal.jsonl").read_bytes() == before


def test_an_unknown_fault_is_named(run: Run, tmp_path: Path) -> None:
    assert made(run, tmp_path)[0] == 0
    code, _, err = run("mended = lambda self, spec: ['no_such']", "status")
    assert (code, "names an unknown fault: no_such" in err) == (2, True)


def test_what_a_plug_in_prints_is_not_in_the_line_of_json(run: Run, tmp_path: Path) -> None:
    more = "def spec(self, path):\n    print('hello')\n    return ArmKind.spec(self, path)"
    assert made(run, tmp_path)[0] == 0
    code, out, err = run(more, "status", "--json")
    assert (code, "hello" in err) == (0, True)
    assert json.loads(out)


def test_a_campaign_of_another_kind_is_refused(run: Run, tmp_path: Path) -> None:
    assert made(run, tmp_path)[0] == 0
    path = tmp_path / "lab" / "campaign.toml"
    path.write_text(path.read_text().replace('kind = "legged"', 'kind = "arm"'))
    code, _, err = run("", "status")
    assert (code, "has the kind 'legged', but campaign.toml states 'arm'" in err) == (2, True)
