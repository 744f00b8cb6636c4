"""The one machine interface for figures: rows of a bench or study, and the line of JSON that carries them."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Row:
    """One measured figure beside what it is compared with.

    Attributes:
        metric: its name, stable between versions.
        value: the figure, in `unit`.
        unit: "ms", "deg", "1", ...
        reference: what it is compared with, in words; empty if with nothing.
        reference_value: the reference's figure in the same unit, or None.
    """

    metric: str
    value: float
    unit: str
    reference: str = ""
    reference_value: float | None = None

    @property
    def ratio(self) -> float | None:
        """value / reference_value; None without a reference, or with a reference of 0."""
        return self.value / self.reference_value if self.reference_value else None


def mean_rows(
    metric: str, values: Sequence[float], unit: str, reference: str, references: Sequence[float]
) -> list[Row]:
    """A mean over seeds and the half width of its 95 % t-interval; nothing where nothing was measured.

    The interval, `<metric>_ci95`, takes two seeds or more; `references` are averaged.
    """
    if not values:
        return []
    from scipy.stats import t

    mean = float(np.mean(values))
    rows = [Row(metric, mean, unit, reference, float(np.mean(references)) if references else None)]
    if len(values) > 1:
        half = float(t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
        rows.append(Row(f"{metric}_ci95", half, unit, "half width over seeds"))
    return rows


def rows_json(rows: Sequence[Row], command: str) -> str:
    """The last line of `etude bench|study NAME --json`: rows, commit and command, on one line."""
    described = [
        {key: _plain(value) for key, value in (asdict(row) | {"ratio": row.ratio}).items()} for row in rows
    ]
    return json.dumps({"rows": described, "commit": commit(), "command": command}, allow_nan=False)


def commit() -> str:
    """The git commit of the checkout this package runs from; the package's version if there is none."""
    package = Path(__file__).parent
    try:
        described = subprocess.run(
            ["git", "-C", str(package), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            capture_output=True,
            text=True,
            check=True,
            timeout=10.0,
        ).stdout.strip()
        tracked = subprocess.run(
            ["git", "-C", str(package), "ls-files", "--error-unmatch", "rows.py"],
            capture_output=True,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return version("etude")
    # a virtual environment inside somebody else's repository has a commit too, but not ours
    return described if tracked.returncode == 0 else version("etude")


def table(rows: Sequence[Row], title: str) -> None:
    """Print the rows for people."""
    from rich.console import Console
    from rich.table import Table

    shown = Table(title=title)
    for heading in ("metric", "value", "unit", "reference", "its value", "ratio"):
        justify: Literal["left", "right"] = "left" if heading in ("metric", "unit", "reference") else "right"
        shown.add_column(heading, justify=justify, overflow="fold")  # on a narrow page no name is cut short
    for row in rows:
        reference = "" if row.reference_value is None else f"{row.reference_value:.4g}"
        ratio = "" if row.ratio is None else f"{row.ratio:.2f}"
        shown.add_row(row.metric, f"{row.value:.4g}", row.unit, row.reference, reference, ratio)
    Console().print(shown)


def _plain(value: object) -> object:
    """JSON has no NaN: a figure that could not be measured is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
