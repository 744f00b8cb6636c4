"""A third kind of robot, from outside: it keeps the laws of every kind, and works installed beside Étude."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from typing import ClassVar

import pytest

from etude.protocols import Kind
from etude.testing import KindSuite, world

VESSEL = Path(__file__).parents[2] / "examples" / "vessel"
LARGEST = 300
sys.path.insert(0, str(VESSEL / "src"))

from etude_vessel import KIND  # noqa: E402  the plug-in is not installed where the tests run


class TestVessel(KindSuite):
    kind: ClassVar[Kind] = KIND
    robot: ClassVar[str] = str(VESSEL / "src" / "etude_vessel" / "vessel.toml")

    # a campaign finds the kind only where it is installed: `test_installed_it_does_the_whole_loop`
    test_the_error_falls_within_two_rounds = None  # type: ignore[assignment]


BUOY = """
from etude.limits import LipschitzLimit

def buoy(spec, model, margins, *, east: float):
    "The vessel stays to the west of a line of buoys."
    return LipschitzLimit("buoys", "vessel", lambda p: p[:, 0], np.array([1.0, 0.0]), -9.0, east, margins)
"""


def test_it_reads_limits_of_its_owners_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "buoys.py").write_text(f"import numpy as np\n{BUOY}")
    monkeypatch.syspath_prepend(str(tmp_path))
    path = tmp_path / "mine.toml"
    path.write_text(Path(TestVessel.robot).read_text() + '[[limit]]\nkind = "buoys:buoy"\neast = 2.0\n')
    spec = KIND.spec(path)
    limit = KIND.limits(spec, None, None, {})[-1]
    (row,) = limit.prove(world(KIND, str(path)).trajectory(0))
    assert (row.quantity, row.upper) == ("buoys", 2.0)


def test_it_is_small() -> None:
    lines = sum(len(path.read_text().splitlines()) for path in (VESSEL / "src").rglob("*.py"))
    assert lines <= LARGEST


def test_nothing_inside_knows_of_it() -> None:
    shown = "src/etude/testing/__init__.py"  # as the example of how a suite is used
    for path in (VESSEL.parents[1] / "src").rglob("*.py"):
        assert path.as_posix().endswith(shown) or "vessel" not in path.read_text(encoding="utf-8"), path


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the plug-in installed by pip; the rest is that of the tests."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder)
    python = folder / "bin" / "python"
    site = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    paths = [sysconfig.get_path("purelib"), *(p for p in sys.path if p.endswith("site-packages"))]
    source = str(VESSEL.parents[1] / "src")
    (Path(site) / "beside.pth").write_text("\n".join(dict.fromkeys([source, *paths])) + "\n")
    pip = [sys.executable, "-m", "pip", "--python", str(python)]
    command = [*pip, "install", "--quiet", "--no-deps", str(VESSEL)]
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0 and "onnection" in done.stderr:
        pytest.skip("pip cannot reach a package index to build the plug-in with")
    assert done.returncode == 0, done.stderr
    return python


LOOP = r"""
import sys
from etude.cli import main
for line in sys.stdin.read().splitlines():
    assert main(line.split()) == 0, line
    print("\f", end="", flush=True)
"""
"""Commands, one a line, a form feed after each; in one process, as it is starting one that takes long."""
COMMANDS = (
    *("plugins", "init lab --robot vessel", "ask lab", "simulate lab --rounds 1"),
    "tell lab lab/simulated/0001.parquet",  # ingested before: nothing is stored again
    *("status lab", "report lab"),
)


@pytest.mark.slow
def test_installed_it_does_the_whole_loop(installed: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [installed, "-c", LOOP],
        input="\n".join(COMMANDS),
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    plugins, _, asked, table, _, status, *_ = done.stdout.split("\f")
    assert "vessel" in plugins
    assert "Proved for all times" in asked
    lines = [line.split() for line in table.splitlines() if line.startswith(("pd", "after"))]
    rows = {words[0]: float(words[-1]) for words in lines}
    assert rows["after"] < 0.8 * rows["pd"]
    assert "learned" in status
    assert (tmp_path / "lab" / "report.html").stat().st_size > 50_000
