"""Another distribution that installs a package of the same name is detected and named."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import etude
from etude import cli
from etude.cli import entrance


def installed(site: Path, name: str, files: str) -> None:
    """A distribution as pip leaves it."""
    info = site / f"{name.replace('-', '_')}-0.2.6.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.2.6\n")
    (info / "RECORD").write_text(files)


def test_another_distribution_with_a_package_etude_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    installed(tmp_path, "etude-sdk", "etude/__init__.py,,\netude/launch/records.py,,\n")
    installed(tmp_path, "etudes", "etudes/__init__.py,,\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    assert entrance.strangers() == ["etude-sdk 0.2.6"]
    assert cli.main(["--version"]) == 0
    said = capsys.readouterr()
    assert said.out == f"etude {etude.__version__}\n"
    assert "etude-sdk 0.2.6" in said.err
    assert "separate environment" in said.err
    assert cli.main(["doctor"]) == 1
    assert "etude-sdk 0.2.6" in capsys.readouterr().out


def test_a_failed_import_names_the_other_distribution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def overwritten(given: list[str]) -> int:
        raise ImportError("cannot import name 'ask' from 'etude'")

    monkeypatch.setattr(entrance, "_run", overwritten)
    installed(tmp_path, "etude-sdk", "etude/__init__.py,,\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    assert cli.main(["status", "lab"]) == 1
    said = capsys.readouterr().err
    assert "annot import name 'ask'" in said
    assert "etude-sdk 0.2.6" in said
    assert "bug" not in said


def test_alone_nobody_is_named() -> None:
    assert entrance.strangers() == []
    assert entrance.conflict() == ""
