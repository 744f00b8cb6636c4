"""Runs of neither arm nor flights: kernels, timings, traces of single runs, related controllers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SMALL_RUNS: tuple[tuple[str, str, int, str, Mapping[str, Any]], ...] = ()
"""Name, what, seeds, function, settings."""
