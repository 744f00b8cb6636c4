"""build_site: the study's claims, verdicts and results in, a folder of static pages out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from etude.errors import EtudeError
from etude_studies.collected import Results
from etude_studies.site import downloads
from etude_studies.site.about import about_page
from etude_studies.site.claim_page import claim_page
from etude_studies.site.context import Study
from etude_studies.site.entry_page import entry_page
from etude_studies.site.numbers import Numbers
from etude_studies.site.overview import overview
from etude_studies.site.page import ABOUT, INDEX, PROTOCOLS, file_of, script, style_sheet
from etude_studies.site.protocols import protocols_page
from etude_studies.site.run_page import run_page
from etude_studies.thesis.ledger import Ledger
from etude_studies.thesis.readings import Reading
from etude_studies.thesis.verdicts import Verdict, judge


def build_site(
    ledger: Ledger,
    verdicts: Mapping[str, Verdict],
    results: Results,
    folder: Path,
    *,
    sensitivity: Sequence[Reading] | None = None,
    what: Mapping[str, str] | None = None,
) -> Path:
    """Writes the pages, and returns the first of them.

    They need no network and no server, and are complete without their script. The same inputs give the same
    bytes: what they say of dates and machines comes from the results.

    Args:
        ledger: claims and entries.
        verdicts: by claim; one that is missing is judged from the results.
        results: all that was measured.
        folder: made if need be; files of the same names are replaced.
        sensitivity: verdicts under other readings, as `readings.readings` gives them; none if None.
        what: a sentence on each run; those of the catalogue if None.

    Raises:
        EtudeError: a page could not be written.
    """
    if not {claim.id for claim in ledger.claims} <= {*verdicts}:
        verdicts = {**judge(ledger, results), **verdicts}
    descriptions = sentences() if what is None else what
    study = Study(ledger, verdicts, Numbers(results), sensitivity or (), descriptions)
    folder = Path(folder)
    for name, text in pages(study):
        _write(folder / name, text)
    return folder / INDEX


def sentences() -> dict[str, str]:
    """What each run of the catalogue is."""
    from etude_studies.thesis.catalogue import catalogue

    return {name: run.what for name, run in catalogue().items()}


def _write(path: Path, text: str) -> None:
    """Without waiting for the disk: hundreds of pages, which the results give again."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        step = "Make room, or choose another folder."
        raise EtudeError(f"the page cannot be written: {error}", where=str(path), next_step=step) from error


def pages(study: Study) -> Iterator[tuple[str, str]]:
    """Every file by its name in the folder."""
    return ((name, made()) for name, made in recipes(study).items())


def recipes(study: Study) -> dict[str, Callable[[], str]]:
    """What makes each of them, by its name."""
    makers: dict[str, Callable[[], str]] = {
        "style.css": style_sheet,
        "site.js": script,
        INDEX: partial(overview, study),
        PROTOCOLS: partial(protocols_page, study),
        ABOUT: partial(about_page, study),
    }
    for entry in study.ledger.entries:
        makers[file_of(entry.id)] = partial(entry_page, study, entry)
        makers[f"{downloads.FOLDER}/{entry.id}.csv"] = partial(downloads.entry_csv, study, entry)
        makers[f"{downloads.FOLDER}/{entry.id}.json"] = partial(downloads.entry_json, study, entry)
    for claim in study.ledger.claims:
        makers[file_of(claim.id)] = partial(claim_page, study, claim)
        makers[f"{downloads.FOLDER}/{claim.id}.csv"] = partial(downloads.claim_csv, study, claim)
        makers[f"{downloads.FOLDER}/{claim.id}.json"] = partial(downloads.claim_json, study, claim)
    for run in study.runs:
        makers[file_of(f"run-{run}")] = partial(run_page, study, run)
    return makers
