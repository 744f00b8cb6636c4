"""docs/thesis.md: every claim with its verdict, every table with its numbers, from what is committed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from etude_studies.collected import Results
from etude_studies.site.mathematics import plain
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import ledger, runs_of
from etude_studies.thesis.kept import kept_results, kept_verdicts, price_s
from etude_studies.thesis.ledger import Claim, Entry, Row
from etude_studies.thesis.part_verdicts import DEPENDS, NOT_RUN, WORDS, PartVerdict
from etude_studies.thesis.presenting import cell
from etude_studies.thesis.verdict_file import Verdict, shown

PAGE = Path(__file__).parents[5] / "docs" / "thesis.md"
"""In the sources."""
HEAD = """# The thesis, answered

Made by `etude study report --update` from the committed results; do not edit. Wiratunga 2014 compares single
runs; here every comparison is over paired seeds, with 95 % intervals and one word by a rule that was fixed
before ([0021](decisions/0021-verdicts.md)). How to run, show and extend it: [studies.md](studies.md). Which
keys of `campaign.toml` give which system: [thesis_settings.md](thesis_settings.md).

The arm and the quadrotors are simulated, after the thesis's descriptions; its arm and its Pelican were
hardware. Expect orderings, not its numbers. What the thesis leaves open, and how it is read: at the end.
"""


def write_thesis_page(path: Path = PAGE) -> None:
    """Writes the page."""
    path.write_text(thesis_page(), encoding="utf-8")


def thesis_page() -> str:
    """The whole page as Markdown."""
    claims_ledger, verdicts, results = ledger(), kept_verdicts(), kept_results()
    parts = [
        HEAD,
        _counts(claims_ledger.claims, verdicts),
        "## Claims\n",
        _claims(claims_ledger.claims, verdicts),
        "## Tables and figures\n",
    ]
    parts += [
        "Ours: mean ± half width of the 95 % interval over seeds (lengths: geometric mean and interval); "
        "in brackets what the thesis prints.\n"
    ]
    parts += [text for entry in claims_ledger.entries if (text := _entry(entry, results))]
    parts += ["## What the thesis leaves open\n"]
    parts += ["\n".join(f"* **{a.id}** {a.what} *{a.resolution}*" for a in claims_ledger.ambiguities) + "\n"]
    parts += ["## Where the numbers come from\n", _origins(results)]
    return "\n".join(parts)


def _counts(claims: Sequence[Claim], verdicts: dict[str, Verdict]) -> str:
    """Of claims that say something of their own."""
    distinct = [claim.id for claim in claims if not claim.alias_of and claim.id in verdicts]
    counted = Counter(shown(verdicts[id]) for id in distinct)
    words = [word for word in (*reversed(WORDS), DEPENDS, NOT_RUN) if counted[word]]
    counts = ", ".join(f"**{counted[word]}** {word}" for word in words)
    repeated = len(claims) - len(distinct)
    return f"Of {len(distinct)} distinct claims: {counts}. {repeated} more say one of them again.\n"


def _claims(claims: Iterable[Claim], verdicts: dict[str, Verdict]) -> str:
    lines = ["| claim | the thesis's words | verdict | numbers |", "|---|---|---|---|"]
    for claim in claims:
        verdict = verdicts.get(claim.id)
        if verdict is None:
            continue
        marks = ", ".join(word for word in ("simulated", "exploratory") if getattr(verdict, word))
        word = f"**{shown(verdict)}**" + (f" ({marks})" if marks else "")
        quote = plain(" ... ".join(claim.quote)).replace("|", "/")
        lines.append(f"| {claim.id} | {quote} | {word} | {_numbers(claim, verdict)} |")
    return "\n".join(lines) + "\n"


def _numbers(claim: Claim, verdict: Verdict) -> str:
    if claim.alias_of:
        return f"as {', '.join(claim.alias_of)}"
    if not any(part.estimate is not None for part in verdict.parts):
        return verdict.reason.replace("|", "/")
    texts = [text for part in verdict.parts if (text := _number(part))]
    return "; ".join([*texts, *([verdict.reason] if verdict.reason else [])])


def _number(part: PartVerdict) -> str:
    if part.estimate is None:
        return ""
    at = "" if part.k is None else f"at {part.k}: "
    printed = "" if part.printed is None else f", thesis {part.printed:.3g}"
    return f"{at}{part.estimate:.3g} ({part.low:.3g} .. {part.high:.3g}), {part.wins}/{part.seeds}{printed}"


def _entry(entry: Entry, results: Results) -> str:
    rows = [*entry.rows, *(Row(label=_line(line), run=line) for line in entry.lines)]
    lines = list(
        _table_lines(entry, rows, results) if entry.kind == "table" else _curve_lines(entry, rows, results)
    )
    if len(lines) < 3:
        return ""
    return f"### {entry.id}: {entry.title} ({entry.unit})\n\n" + "\n".join(lines) + "\n"


def _table_lines(entry: Entry, rows: list[Row], results: Results) -> Iterator[str]:
    yield f"| {f'after {entry.at[-1]}' if entry.at[-1] else ''} | {' | '.join(entry.columns)} | seeds |"
    yield "|---" * (len(entry.columns) + 2) + "|"
    for row in rows:
        k = (row.at or entry.at)[-1]
        cells = [cell(results, entry, row.run, column, k) for column in entry.columns]
        if any(item.asked for item in cells):
            printed = [f" [{value:g}]" for value in row.printed] + [""] * len(cells)
            texts = [item.text + text for item, text in zip(cells, printed, strict=False)]
            yield f"| {row.label} | {' | '.join(texts)} | {max(item.asked for item in cells)} |"


def _curve_lines(entry: Entry, rows: list[Row], results: Results) -> Iterator[str]:
    """The last column, which is the mean where there is one, against k."""
    yield f"| {entry.columns[-1]} after | {' | '.join(map(str, entry.at))} | seeds |"
    yield "|---" * (len(entry.at) + 2) + "|"
    for row in rows:
        cells = [cell(results, entry, row.run, entry.columns[-1], k) for k in entry.at]
        if any(item.asked for item in cells):
            most = max(item.asked for item in cells)
            yield f"| {row.label} | {' | '.join(item.text for item in cells)} | {most} |"


def _line(source: str) -> str:
    run, _, model = source.partition(":")
    named = {"B0": "feedback alone", "B1": "exact inverse", "B2": "exact inverse without friction"}
    return named.get(run, f"{model.replace('_', ', ')} ({run})" if model else run)


def _origins(results: Results) -> str:
    runs_by_name = catalogue()
    missing = [name for name in runs_of("all") if name not in results.runs]
    lines = ["| run | what | seeds | planned | commit | CPU s a seed |", "|---|---|---|---|---|---|"]
    for run in results.runs:
        made, seeds, listed = results.made(run), len(results.seeds(run)), runs_by_name[run]
        cost = f"{made['cpu_s'] / seeds:.3g}"
        lines.append(
            f"| {run} | {listed.what} | {seeds} | {listed.seeds} | {results.commits(run)} | {cost} |"
        )
    missing_line = f"\nNot run yet: {', '.join(missing)}.\n" if missing else ""
    return "\n".join(lines) + "\n" + missing_line + _price(results)


def _price(results: Results) -> str:
    """What the thesis's own runs cost with as many seeds as planned."""
    thesis_runs = [
        listed for name in runs_of("thesis") if name in results.runs for listed in [catalogue()[name]]
    ]
    spent = sum(price_s([run.name], run.seeds, results) for run in thesis_runs)
    lack = sum(price_s([run.name], run.seeds, results, more=True) for run in thesis_runs)
    return (
        f"\nAll runs of `thesis` with their planned seeds take {spent / 3600.0:.1f} h of CPU time; "
        f"{lack / 3600.0:.1f} h of them are not run yet.\n"
    )
