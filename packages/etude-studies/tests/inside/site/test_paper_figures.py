"""Figures for print: drawn from results, the same bytes again, a plain word where matplotlib lacks."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from made_up_study import small_study

from etude.errors import UsageError
from etude_studies.collected import Results
from etude_studies.site.paper import paper_figures, paper_tables, tex

ONLY = ("table-6.9", "figure-6.11")


def test_without_matplotlib_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    ledger, results, _ = small_study()
    with pytest.raises(UsageError, match=r"pip install 'matplotlib>=3.8'"):
        paper_figures(ledger, results, tmp_path)


def test_tables_and_curves_are_written_twice_alike(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pip install 'matplotlib>=3.8'")
    ledger, results, _ = small_study()
    first, second = (paper_figures(ledger, results, tmp_path / name, only=ONLY) for name in "ab")
    assert [path.name for path in first] == [f"{id}.{kind}" for id in ONLY for kind in ("pdf", "svg")]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(first, second, strict=True))
    assert first[0].read_bytes().startswith(b"%PDF")
    for label in ("Downsampling", "Dictionary (variance)", "mean tracking error (deg)", "PD alone"):
        assert label in first[1].read_text(encoding="utf-8")


def test_tables_are_written_in_latex(tmp_path: Path) -> None:
    ledger, results, _ = small_study()
    written = {
        path.name: path.read_text(encoding="utf-8") for path in paper_tables(ledger, results, tmp_path)
    }
    assert "table-6.9.tex" in written
    assert "figure-6.10.tex" not in written
    own = written["table-6.9.tex"]
    assert r"95 \% t interval" in own
    assert r"\label{table-6.9}" in own
    rows = [line for line in own.splitlines() if line.endswith(r"\\")]
    assert {line.count("&") for line in rows} == {6}
    (line,) = (line for line in rows if line.startswith("Dictionary (variance)"))
    x = list(results.values("A5", "error", 6, "fourier", "wrist").values())
    assert f"{np.mean(x):.4g}" in line
    assert line.endswith(rf"& {len(x)} \\")
    assert tex("50 % of a_1 & b") == r"50 \% of a\_1 \& b"


def test_entries_without_results_are_left_out_and_unknown_ones_refused(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pip install 'matplotlib>=3.8'")
    ledger, results, _ = small_study()
    assert paper_figures(ledger, Results({}, {}), tmp_path) == ()
    with pytest.raises(UsageError, match=re.escape("table-6.9")):
        paper_figures(ledger, results, tmp_path, only=["table-6.99"])
