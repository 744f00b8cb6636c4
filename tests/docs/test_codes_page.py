"""The page of codes is the table of sentences."""

from __future__ import annotations

import importlib.util

from test_docs import ROOT

from etude.codes import SENTENCES

DOCS = ROOT / "docs"


def test_the_page_is_what_the_table_says() -> None:
    """After a change of the table: python docs/codes.py."""
    spec = importlib.util.spec_from_file_location("docs_codes", DOCS / "codes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (DOCS / "reference" / "codes.md").read_text(encoding="utf-8")
    assert page == module.page()
    assert all(f"| `{code}` |" in page for code in SENTENCES)
