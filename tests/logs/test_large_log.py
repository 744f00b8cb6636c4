"""Memory of long logs; a program of its own, since a process's peak does not fall."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("large_log.py")


@pytest.mark.slow
@pytest.mark.parametrize("digits", [6, 12])
def test_a_million_rows_fit_into_400_mb(digits: int) -> None:
    command = [sys.executable, str(SCRIPT), str(digits)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["rows"] == 1_000_000
    assert told["peak_mb"] < 400.0
