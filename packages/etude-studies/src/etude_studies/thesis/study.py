"""etude study: the thesis's figures, tables and claims, run, listed, shown and reported."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

import msgspec

from etude.errors import UsageError
from etude.report import Pages, digest_of
from etude_studies.collected import Results, collect
from etude_studies.engines.schedule import Report
from etude_studies.thesis.again import Again, again
from etude_studies.thesis.catalogue import Run, run_named
from etude_studies.thesis.choosing import GROUPS, entries_of, ids, ledger, runs_of, unknown
from etude_studies.thesis.computing import Chosen, Say
from etude_studies.thesis.kept import (
    blocks,
    kept_results,
    kept_verdicts,
    planned_seeds,
    price_s,
    renew,
    so_far,
    unpack,
    verdicts_of,
)
from etude_studies.thesis.ledger import Claim, Entry, Row
from etude_studies.thesis.method import with_method
from etude_studies.thesis.part_verdicts import UNTESTED
from etude_studies.thesis.parts import run_of
from etude_studies.thesis.presenting import (
    comparison_lines,
    entry_table,
    numbers,
    run_line,
    verdict_sentence,
)
from etude_studies.thesis.verdict_file import Verdict, shown
from etude_studies.thesis.verdicts import judge
from etude_studies.world import World

COLLECTED = "collected"
FOLDED = (
    "{} folds of one log share most of their training data: intervals are too narrow, and words are hints."
)
LEAST, WIDE = 80, 110
"""Columns below which a table is not broken further, and below which its cells are."""


@dataclass(frozen=True)
class Listed:
    """One row of `etude study list`.

    Attributes:
        id: what it is asked for by. what: one line.
        seeds: committed, of the run with fewest. verdict: its word; "" of what is no claim.
    """

    id: str
    what: str
    seeds: int
    verdict: str

    @property
    def command(self) -> str:
        """What computes it."""
        return f"etude study run {self.id}"


class ThesisStudy:
    """What `etude study` offers of the thesis; see `etude.cli.study.StudiesPackage`."""

    def rows(self) -> list[Listed]:
        """Every group, figure, table and claim."""
        claims_ledger, verdicts, results = ledger(), kept_verdicts(), kept_results()
        groups = [Listed(id, what, 0, "") for id, what in GROUPS.items()]
        entries = [Listed(e.id, e.title, _seeds(e.id, results), "") for e in claims_ledger.entries]
        claims = [
            Listed(c.id, " ... ".join(c.quote), _seeds(c.id, results), _word(verdicts, c.id))
            for c in claims_ledger.claims
        ]
        return [*groups, *entries, *claims]

    def knows(self, id: str) -> bool:
        """Whether it is one of its ids, runs among them."""
        return id in ids()

    def refuse(self, id: str) -> UsageError:
        """What to say of an id that nobody knows."""
        return unknown(id)

    def run(self, id: str, options: Mapping[str, Any], say: Say) -> tuple[str, dict[str, Any]]:
        """Computes what an id stands for, as far as it is not in the folder; text and data.

        Args:
            options: `seeds` (None: as planned), `seed` (the first), `folder`, `workers`, `cluster`, `shard`,
                `method`, `limit_s`, `go_on` (count the committed results as done); `logs` and `robot`, files
                of a recorded log and its arm, on which a table is computed instead, with `seeds` folds.
        """
        if options["logs"]:
            return _recorded(id, options)
        runs = [run_named(name) for name in runs_of(id)]
        added = _methods(runs, options["method"])
        chosen = Chosen.of([*runs, *added], options["seed"], options["seeds"])
        store = Path(options["folder"]) / "thesis"
        if options["go_on"]:
            say(f"{unpack(runs, store, kept_results())} committed results are taken as done.")
        report = chosen.computed(store, options, say)
        if options["shard"]:
            text = f"{len(report.ran)} runs computed, {len(report.kept)} were there."
            return text, _counted(report, chosen)
        collect(store, chosen.by_run, store / COLLECTED)
        results = Results.load(store / COLLECTED)
        counts, beside = _counted(report, chosen), _beside(report, chosen, results)
        lines = [_shown(id, results, added), *(one.sentence for one in beside)]
        lines += [f"{name} failed: {why}" for name, why in counts["failed"].items()]
        committed = {one.run: one.as_dict() for one in beside}
        return "\n".join(lines), {
            **counts,
            "rows": entry_rows(entries_of(id), results, added),
            "committed": committed,
        }

    def show(self, id: str) -> tuple[str, dict[str, Any]]:
        """What is committed of a claim, a figure, a table or a run."""
        claims_ledger, results, verdicts = ledger(), kept_results(), kept_verdicts()
        claim = next((one for one in claims_ledger.claims if one.id == id), None)
        if claim is not None and id in verdicts:
            verdict = verdicts[id]
            lines = [verdict_sentence(claim, verdict), *(f"  {line}" for line in numbers(verdict))]
            lines += [f"  thesis: {claim.thesis}"] if claim.thesis else []
            lines += [f"  {text}" for text in (claim.note, claim.contradicts) if text]
            if verdict.asks:
                price = price_s(runs_of(id), verdict.asks, results, more=True)
                command = f"etude study run {id} --seeds {verdict.asks} --go-on"
                lines += [f"  to decide it ({price:.0f} CPU seconds): {command}"]
            lines += [f"  again: etude study run {id}"]
            return "\n".join(lines), {"id": id, "verdict": verdict.word, "parts": numbers(verdict)}
        if not self.knows(id):
            raise unknown(id)
        text = entry_lines(entries_of(id), results, ())
        what = "\n".join(f"{run.name}: {run.what}" for run in map(run_named, runs_of(id)))
        return f"{text}\n{what}", {"id": id, "rows": entry_rows(entries_of(id), results, ())}

    def report(self, folder: Path, options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
        """Writes the pages of what is committed; of runs with more seeds in the store, of those.

        Args:
            folder: of the pages.
            options: `update`, to commit the store's results first; `folder` of the store; `paper`, a folder
                for figures or None.
        """
        from etude_studies.site.build import build_site
        from etude_studies.thesis.readings import readings

        store = Path(options["folder"]) / "thesis"
        if options["update"]:
            _renewed(store)
        results = so_far(_all_runs(), store, more=True)
        other = readings(ledger(), results, planned=planned_seeds(results), blocks=blocks())
        verdicts = verdicts_of(results)
        page = build_site(ledger(), verdicts, results, folder, sensitivity=other)
        written = _printed(verdicts, results, Path(options["paper"])) if options["paper"] else []
        notes = (
            [f"{len(written)} files in {options['paper']}, paper.pdf and data.zip among them"]
            if written
            else []
        )
        return "\n".join([str(page), *notes]), {"page": str(page), "figures": [str(path) for path in written]}

    def live(self, options: Mapping[str, Any]) -> Pages:
        """The same pages to be served, of the committed results and what `folder` has of them so far."""
        store = Path(options["folder"]) / "thesis"

        def made() -> dict[str, Callable[[], str]]:
            from etude_studies.site.build import recipes, sentences
            from etude_studies.site.context import Study
            from etude_studies.site.numbers import Numbers

            results = so_far(_all_runs(), store)
            verdicts = verdicts_of(results) if store.exists() else kept_verdicts()
            return recipes(Study(ledger(), verdicts, Numbers(results), (), sentences()))

        return Pages(made, lambda: digest_of([store]))


STUDY = ThesisStudy()


def _all_runs() -> list[Run]:
    return [run_named(name) for name in (*runs_of("all"), *runs_of("miniature"))]


def _recorded(id: str, options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """A table of models on a recorded log, and the words of the claims that it answers."""
    from etude_studies.thesis.recorded import Recorded, claims_of_log, entry_of_log, runs_on_logs

    entry = next((one for one in ledger().entries if one.id == id), None)
    if entry is None:
        step = "Take a table of 6.1 to 6.9, such as table-6.9."
        raise UsageError(f"{id} is no table, so no log answers it", where="--logs", next_step=step)
    runs = runs_on_logs(entry)
    recorded = Recorded.of(Path(options["logs"]), options["robot"], options["seeds"])
    log_entry, results = entry_of_log(entry, World.of(recorded.robot)), recorded.results(runs)
    claims = claims_of_log(ledger(), runs, recorded.folds)
    verdicts = judge(msgspec.structs.replace(ledger(), claims=claims), results)
    lines = [entry_lines([log_entry], results, ()), FOLDED.format(recorded.folds)]
    for claim in claims:
        real = msgspec.structs.replace(verdicts[claim.id], simulated=False)
        lines += [verdict_sentence(claim, real), *(f"  {line}" for line in numbers(real))]
    verdict_words = {claim.id: verdicts[claim.id].word for claim in claims}
    return "\n".join(lines), {"rows": entry_rows([log_entry], results, ()), "words": verdict_words}


def _printed(verdicts: Mapping[str, Verdict], results: Results, folder: Path) -> list[Path]:
    """Figures, tables, the whole document and the committed data; the files."""
    from etude_studies.site.paper import paper_figures, paper_tables
    from etude_studies.site.paper_document import data_archive, paper_document

    figures = paper_figures(ledger(), results, folder)
    tables = paper_tables(ledger(), results, folder)
    document = paper_document(ledger(), verdicts, results, folder)
    return [*figures, *tables, *document, data_archive(folder / "data.zip")]


def _renewed(store: Path) -> None:
    """Commits what a store has, and judges all claims anew. UsageError: these are not the sources."""
    from etude_studies.thesis.pages import PAGE, write_thesis_page

    if not PAGE.parent.is_dir():
        step = "Clone it, and pip install -e . there."
        raise UsageError("this is no checkout of Étude's sources", where=str(PAGE.parent), next_step=step)
    renew(_all_runs(), store)
    kept_results.cache_clear()
    kept_verdicts.cache_clear()
    write_thesis_page()


def _beside(report: Report, chosen: Chosen, results: Results) -> list[Again]:
    """What was computed now, beside what is committed of it."""
    ran, committed = set(report.ran), kept_results()
    seeds = {run: [spec.seed for spec in specs if spec in ran] for run, specs in chosen.by_run.items()}
    comparisons = [again(run, computed, results, committed) for run, computed in seeds.items()]
    return [one for one in comparisons if one is not None]


def _methods(runs: Sequence[Run], method: str) -> list[Run]:
    if not method:
        return []
    changed_runs = [changed for changed in (with_method(run, method) for run in runs) if changed is not None]
    if not changed_runs:
        raise UsageError(
            f"no run behind this has a place for {method}",
            where="--method",
            next_step="A kernel fits dictionaries and full regression, a criterion designed trajectories.",
        )
    return changed_runs


def _shown(id: str, results: Results, added: Sequence[Run]) -> str:
    lines = [entry_lines(entries_of(id), results, added)]
    if not lines[0]:
        lines = [run_line(name, results) for name in (*runs_of(id), *(run.name for run in added))]
    verdicts = verdicts_of(results)
    for claim in ledger().claims:
        relevant = claim.id == id or id in claim.rests_on or id in _read(claim)
        if relevant and verdicts[claim.id].word != UNTESTED:
            lines.append(verdict_sentence(claim, verdicts[claim.id]))
    return "\n".join(line for line in lines if line)


def _read(claim: Claim) -> set[str]:
    """The runs that the parts of a claim read."""
    return {run_of(source) for part in claim.parts for source in part.sources}


def entry_lines(entries: Sequence[Entry], results: Results, added: Sequence[Run]) -> str:
    from io import StringIO

    from rich.console import Console

    out = StringIO()
    console = Console(file=out, width=max(LEAST, get_terminal_size((LEAST, 24)).columns))
    for entry in entries:
        table = entry_table(entry, results, _more(entry, added), narrow=console.width < WIDE)
        if table.row_count:
            console.print(table)
            console.print("\n".join(comparison_lines(entry, results)), soft_wrap=True)
    return out.getvalue().rstrip()


def _more(entry: Entry, added: Sequence[Run]) -> list[Row]:
    """A row of somebody's method below each row whose run it took part in."""
    return [
        Row(label=f"{row.label}, {run.name.partition('+')[2]}", run=run.name, at=row.at)
        for row in entry.rows
        for run in added
        if run.name.partition("+")[0] == row.run
    ]


def entry_rows(entries: Sequence[Entry], results: Results, added: Sequence[Run]) -> list[dict[str, Any]]:
    from etude_studies.thesis.presenting import cell

    rows = []
    for entry in entries:
        for row in [*entry.rows, *_more(entry, added)]:
            k = (row.at or entry.at)[-1]
            for column in entry.columns:
                item = cell(results, entry, row.run, column, k)
                if item.seeds:
                    rows.append(
                        {
                            "metric": f"{entry.id}, {row.label}, {column}",
                            "value": item.mean,
                            "low": item.low,
                            "high": item.high,
                            "seeds": item.seeds,
                            "unit": entry.unit,
                            "k": k,
                        }
                    )
    return rows


def _counted(report: Report, chosen: Chosen) -> dict[str, Any]:
    return {
        "ran": len(report.ran),
        "kept": len(report.kept),
        "recomputed": len(report.recomputed),
        "failed": {chosen.names.get(spec, spec.label): why for spec, why in report.failed.items()},
        "noted": {chosen.names.get(spec, spec.label): note for spec, note in report.noted.items()},
    }


def _seeds(id: str, results: Results) -> int:
    try:
        names = runs_of(id)
    except UsageError:
        return 0
    return min((len(results.seeds(name)) for name in names), default=0)


def _word(verdicts: Mapping[str, Verdict], id: str) -> str:
    return shown(verdicts[id]) if id in verdicts else ""
