"""The notebooks run from top to bottom, in an empty folder beside the examples, and come without outputs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
SECONDS = 600
"""A cell that takes longer hangs."""


@pytest.mark.parametrize("book", BOOKS, ids=lambda p: p.stem)
def test_a_notebook_comes_without_outputs(book: Path) -> None:
    cells = json.loads(book.read_text(encoding="utf-8"))["cells"]
    assert [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")] == []


@pytest.mark.slow
@pytest.mark.parametrize("book", BOOKS, ids=lambda p: p.stem)
@pytest.mark.filterwarnings("default")  # of the libraries that run notebooks
def test_a_notebook_runs(book: Path, tmp_path: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="pip install '.[test]'")
    nbclient = pytest.importorskip("nbclient", reason="pip install '.[test]'")
    pytest.importorskip("ipykernel", reason="pip install '.[test]'")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    found = nbformat.read(book, as_version=4)
    nbclient.NotebookClient(found, timeout=SECONDS, resources={"metadata": {"path": str(tmp_path)}}).execute()
    code = [cell for cell in found.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code)
    errors = [out.text for cell in code for out in cell.outputs if out.get("name") == "stderr"]
    assert errors == []


def test_every_notebook_is_on_the_page() -> None:
    page = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
    assert len(BOOKS) == 2
    assert all(f"examples/notebooks/{book.name}" in page for book in BOOKS)
