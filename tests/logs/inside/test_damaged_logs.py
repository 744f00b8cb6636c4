"""No damaged log ends the program, takes 10 s or 1 GB: ten a reader each day, 50,000 if slow."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="bags need the extra 'ros'")
pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
from damage import FORMATS

from etude import plugins
from etude.logs.readers.registry import GROUP

SCRIPT = Path(__file__).with_name("damage.py")
SHARES = {
    reader: [name for name, own in FORMATS.items() if own[0] == reader] for reader, _ in FORMATS.values()
}


def survived(first: int, count: int, *formats: str) -> None:
    """Reads so many damaged logs of each format, in a program of their own."""
    command = [sys.executable, "-W", "error", str(SCRIPT), str(first), str(count), *formats]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stderr == ""
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["count"] for row in rows] == [count] * len(formats)
    for row in rows:
        assert row["slowest_s"][0] < 10.0, row
        assert row["peak_mb"] < 1000.0, row


def test_every_reader_is_here() -> None:
    assert set(SHARES) == set(plugins.BUILT_IN[GROUP])


@pytest.mark.parametrize("share", sorted({len(own) for own in SHARES.values()}))
def test_ten_of_every_reader(share: int) -> None:
    formats = [name for own in SHARES.values() if len(own) == share for name in own]
    survived(0, -(-10 // share), *formats)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_thousands_of_every_format(name: str) -> None:
    """19 formats of 3,400 each, at least as many a reader."""
    survived(1000, 3400, name)
