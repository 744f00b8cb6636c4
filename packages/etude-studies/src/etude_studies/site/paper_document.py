"""The study as one document for print: every word, table and figure, in LaTeX and as a PDF; and its data."""

from __future__ import annotations

import hashlib
import textwrap
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from etude.errors import EtudeError
from etude_studies.collected import Results
from etude_studies.site.about import RULE
from etude_studies.site.claim_words import deciding, estimate
from etude_studies.site.mathematics import plain
from etude_studies.site.numbers import Numbers
from etude_studies.site.page import SOURCE
from etude_studies.site.paper import SETTINGS, caption, cells, drawing_of, has_results, pyplot, tex
from etude_studies.site.words import column_name, entry_name
from etude_studies.thesis.kept import FOLDER
from etude_studies.thesis.ledger import Claim, Entry, Ledger
from etude_studies.thesis.verdict_file import Verdict, shown

PAGE_INCHES = (8.27, 11.69)
LINES = 70
"""Claims on a page."""
WIDTH = 100
"""Characters of a line of text."""
TITLE = "Does the thesis hold?"
MANIFEST = "MANIFEST.sha256"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The date of every file in an archive, so that the same results give the same bytes."""
CITATIONS = (Path(__file__).parents[1] / "CITATION.cff", Path(__file__).parents[5] / "CITATION.cff")
"""In an installed package, and in a checkout."""
READ_ME = f"""Results of the study of {SOURCE}.

results/*.parquet: every figure of every seed of a run; with each its settings, hashes, commit and machine.
results/verdicts.json: the words. claims.toml, tables.toml: what is claimed, and the thesis's own numbers.
Check the files: sha256sum -c {MANIFEST}. To cite: CITATION.cff.
"""


def paper_document(
    ledger: Ledger, verdicts: Mapping[str, Verdict], results: Results, folder: Path
) -> tuple[Path, Path]:
    """Writes `paper.tex`, which takes in the tables and figures beside it, and `paper.pdf`, whole.

    The PDF needs no LaTeX. The same inputs give the same bytes.

    Args:
        ledger, verdicts, results: of the study.
        folder: of `paper.paper_figures` and `paper.paper_tables`.

    Raises:
        UsageError: matplotlib is not installed.
    """
    entries = [entry for entry in ledger.entries if entry.kind != "trace" and has_results(entry, results)]
    source, printed = folder / "paper.tex", folder / "paper.pdf"
    source.write_text("\n".join(_latex(ledger, verdicts, results, entries)) + "\n", encoding="utf-8")
    _print(printed, ledger, verdicts, results, entries)
    return source, printed


def data_archive(path: Path, folder: Path = FOLDER) -> Path:
    """Writes results, claims and printed numbers as a zip with a manifest of SHA-256 sums; its path.

    Args:
        path: of the zip. folder: of the results, beside the files of claims and tables.

    Raises:
        EtudeError: it could not be written.
    """
    sources = {f"results/{one.name}": one for one in sorted(folder.iterdir()) if one.is_file()}
    sources |= {name: folder.parent / name for name in ("claims.toml", "tables.toml")}
    files = {name: one.read_bytes() for name, one in sources.items()} | {"README.txt": READ_ME.encode()}
    files["CITATION.cff"] = next(one for one in CITATIONS if one.exists()).read_bytes()
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in files.items())
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in {**files, MANIFEST: sums.encode()}.items():
                archive.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED)
    except OSError as error:
        step = "Make room, or choose another folder."
        raise EtudeError(
            f"the archive cannot be written: {error}", where=str(path), next_step=step
        ) from error
    return path


def _verdict_row(claim: Claim, verdict: Verdict) -> tuple[str, str, str, str]:
    """Id, word, the deciding number and the claim's own words."""
    part = deciding(verdict)
    return claim.id, shown(verdict), estimate(part) if part else "", plain(" ... ".join(claim.quote))


def _claims_sentence(entry: Entry, ledger: Ledger, verdicts: Mapping[str, Verdict]) -> str:
    """The words of the claims that rest on an entry first."""
    claims = [claim for claim in ledger.claims if claim.rests_on[:1] == (entry.id,) and not claim.alias_of]
    phrases = "; ".join(f"{claim.id} {shown(verdicts[claim.id])}" for claim in claims)
    return f" Claims: {phrases}." if phrases else ""


def _latex(
    ledger: Ledger, verdicts: Mapping[str, Verdict], results: Results, entries: Sequence[Entry]
) -> Iterator[str]:
    yield from (r"\documentclass{article}", r"\usepackage{booktabs,graphicx,longtable}")
    yield from (r"\begin{document}", rf"\title{{{TITLE}}}\author{{}}\date{{}}\maketitle")
    yield f"{tex(SOURCE)}.\n\n\\section{{The rule}}\n"
    yield from (f"{tex(content)}\n" for content in RULE)
    yield r"\section{The words}" + "\n" + r"\begin{longtable}{lllp{0.5\textwidth}}"
    for claim in ledger.claims:
        yield " & ".join(tex(content) for content in _verdict_row(claim, verdicts[claim.id])) + r" \\"
    yield r"\end{longtable}" + "\n" + r"\section{Tables and figures}"
    for entry in entries:
        if entry.kind == "table":
            yield rf"\input{{{entry.id}.tex}}"
        else:
            caption_text = tex(caption(entry, results) + _claims_sentence(entry, ledger, verdicts))
            drawn = rf"\includegraphics{{{entry.id}.pdf}}"
            yield (
                rf"\begin{{figure}}\centering{drawn}\caption{{{caption_text}}}\label{{{entry.id}}}"
                + r"\end{figure}"
            )
    yield r"\end{document}"


def _print(
    path: Path,
    ledger: Ledger,
    verdicts: Mapping[str, Verdict],
    results: Results,
    entries: Sequence[Entry],
) -> None:
    """A page of the rule, pages of words, a page for each entry."""
    plt = pyplot()
    from matplotlib.backends.backend_pdf import PdfPages

    numbers = Numbers(results)
    with plt.rc_context(SETTINGS), PdfPages(path, metadata={"CreationDate": None, "Title": TITLE}) as pages:

        def keep(page: Any) -> None:
            pages.savefig(page)
            plt.close(page)

        keep(_text_page(plt, TITLE, [f"{SOURCE}.", *RULE]))
        lines = [_line(*_verdict_row(claim, verdicts[claim.id])) for claim in ledger.claims]
        for first in range(0, len(lines), LINES):
            keep(_text_page(plt, "The words", ["\n".join(lines[first : first + LINES])], mono=True))
        for entry in entries:
            caption_text = caption(entry, results) + _claims_sentence(entry, ledger, verdicts)
            keep(_entry_page(plt, numbers, results, entry, caption_text))


def _line(id: str, word: str, number: str, quote: str) -> str:
    return f"{id:11}{word:23}{number:26}{textwrap.shorten(quote, 58, placeholder=' ...')}"


def _text_page(plt: Any, title: str, parts: Sequence[str], *, mono: bool = False) -> Any:
    page = plt.figure(figsize=PAGE_INCHES)
    page.text(0.08, 0.94, title, fontsize=14, weight="bold", va="top")
    body = "\n\n".join(part if mono else textwrap.fill(part, WIDTH) for part in parts)
    family = {"family": "monospace", "fontsize": 6.2} if mono else {"fontsize": 9}
    page.text(0.08, 0.9, body.replace("$", r"\$"), va="top", linespacing=1.5, **family)
    return page


def _entry_page(plt: Any, numbers: Numbers, results: Results, entry: Entry, caption_text: str) -> Any:
    """The drawing with its caption; the numbers of a table below."""
    page = plt.figure(figsize=PAGE_INCHES)
    page.text(0.08, 0.95, entry_name(entry.id), fontsize=12, weight="bold", va="top")
    axes = page.add_axes((0.3, 0.58, 0.5, 0.31))
    drawing_of(entry)(axes, numbers, entry)
    if axes.get_legend_handles_labels()[1]:
        page.legend(loc="upper left", bbox_to_anchor=(0.08, 0.53), ncols=3, frameon=False, fontsize=7)
    page.text(0.08, 0.44, textwrap.fill(caption_text, WIDTH).replace("$", r"\$"), fontsize=8, va="top")
    rows = cells(entry, results) if entry.kind == "table" else []
    if rows:
        below = page.add_axes((0.08, 0.05, 0.86, 0.3))
        below.axis("off")
        heads = ["", *(column_name(column) for column in entry.columns), "n"]
        wide = [0.26, *[0.66 / len(entry.columns)] * len(entry.columns), 0.05]
        grid = below.table(rows, colLabels=heads, colWidths=wide, loc="upper left", cellLoc="right", edges="")
        grid.auto_set_font_size(False)
        grid.set_fontsize(7 if len(entry.columns) < 8 else 4)
    return page
