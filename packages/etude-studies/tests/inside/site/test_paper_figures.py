"""Figures for print: drawn from results, the same bytes again, a plain word where matplotlib lacks."""

from __future__ import annotations

import hashlib
import re
import sys
import zipfile
from pathlib import Path

import msgspec
import numpy as np
import pytest
from made_up_study import small_study

from etude.errors import UsageError
from etude_studies.collected import Results
from etude_studies.site.paper import paper_figures, paper_tables, tex
from etude_studies.site.paper_document import MANIFEST, data_archive, paper_document

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


def test_the_whole_study_is_one_document(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pip install 'matplotlib>=3.8'")
    ledger, results, verdicts = small_study()
    asked = tuple(entry for entry in ledger.entries if entry.id in ONLY)
    ledger = msgspec.structs.replace(ledger, entries=asked)
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
        paper_document(ledger, verdicts, results, folder)
    source, printed = (folders[0] / name for name in ("paper.tex", "paper.pdf"))
    assert printed.read_bytes() == (folders[1] / "paper.pdf").read_bytes()
    assert printed.read_bytes().startswith(b"%PDF")
    text = source.read_text(encoding="utf-8")
    assert r"\input{table-6.9.tex}" in text
    assert r"\includegraphics{figure-6.11.pdf}" in text
    assert len(re.findall(r"^C[\w.-]+ & ", text, re.M)) == len(ledger.claims)


def test_an_archive_of_the_data_proves_itself(tmp_path: Path) -> None:
    folder = tmp_path / "thesis" / "results"
    folder.mkdir(parents=True)
    (folder / "A1.parquet").write_bytes(b"rows")
    for name in ("claims.toml", "tables.toml"):
        (folder.parent / name).write_text("")
    with zipfile.ZipFile(data_archive(tmp_path / "data.zip", folder)) as archive:
        sums = dict(line.split("  ")[::-1] for line in archive.read(MANIFEST).decode().splitlines())
        assert {*sums} == {*archive.namelist()} - {MANIFEST}
        assert {"results/A1.parquet", "CITATION.cff"} <= {*sums}
        assert all(hashlib.sha256(archive.read(name)).hexdigest() == told for name, told in sums.items())
