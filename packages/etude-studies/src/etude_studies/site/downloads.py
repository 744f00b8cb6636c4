"""The numbers behind a page as CSV and JSON, beside the pages."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from etude.report import Html, element
from etude_studies.site.context import Study
from etude_studies.site.numbers import counts, figure_of, printed
from etude_studies.site.words import once
from etude_studies.thesis.ledger import Claim, Entry

FOLDER = "data"
NUMBERS = ("label", "source", "k", "test", "measure", "part", "seed", "value")
CONTRASTS = ("claim", "part", "k", "seed", "x")


def data_links(id: str) -> Html:
    """To both files."""
    links = (
        element("a", kind.upper(), href=f"{FOLDER}/{id}.{kind}", download="") for kind in ("csv", "json")
    )
    return element("p", "Download the numbers, each seed: ", *_parted(links), class_="downloads")


def entry_csv(study: Study, entry: Entry) -> str:
    """Every seed of everything that the entry shows, one number a line."""
    return _csv(NUMBERS, _numbers(study, entry))


def entry_json(study: Study, entry: Entry) -> str:
    """The entry, its rows with printed numbers and summaries, and its verdicts."""
    rows = [
        _row(study, entry, row.run, row.label, printed(entry, row), counts(entry, row)) for row in entry.rows
    ]
    rows += [
        _row(study, entry, source, source, {}, entry.at)
        for source in once((*entry.lines, *entry.beside, *entry.sensitivity))
    ]
    verdicts = {claim.id: study.verdicts[claim.id].word for claim in study.claims_of(entry)}
    return _json({"entry": msgspec.to_builtins(entry), "rows": rows, "verdicts": verdicts})


def claim_csv(study: Study, claim: Claim) -> str:
    """x of every seed of every part."""
    return _csv(CONTRASTS, _contrasts(study, claim))


def claim_json(study: Study, claim: Claim) -> str:
    """The claim, its verdict, and the verdicts under other readings."""
    readings = {reading.name: verdict.word for reading, verdict in study.readings_of(claim)}
    data = {"claim": claim, "verdict": study.verdicts[claim.id], "readings": readings}
    return _json(msgspec.to_builtins(data))


def _numbers(study: Study, entry: Entry) -> Iterator[tuple[Any, ...]]:
    labels = {row.run: row.label for row in entry.rows}
    for source in entry.sources:
        for column in entry.columns:
            measure, part = figure_of(entry, column)
            for k, by_seed in study.numbers.by_k(source, measure, entry.test, part).items():
                for seed, value in by_seed.items():
                    yield labels.get(source, ""), source, k, entry.test, measure, part, seed, _short(value)


def _contrasts(study: Study, claim: Claim) -> Iterator[tuple[Any, ...]]:
    for index, part in enumerate(claim.parts):
        for contrast in study.contrasts_of(claim, part):
            for seed, x in sorted(contrast.x.items()):
                yield claim.id, index + 1, "" if contrast.k is None else contrast.k, seed, _short(x)


def _row(
    study: Study,
    entry: Entry,
    source: str,
    label: str,
    printed_numbers: Mapping[str, float],
    at: tuple[int, ...],
) -> dict[str, Any]:
    cells = []
    for column in entry.columns:
        for k in at:
            result = study.numbers.summary(entry, source, column, k)
            if result:
                numbers = {"mean": result.mean, "low": result.low, "high": result.high}
                cells.append(
                    {"column": column, "k": k, **{n: _short(v) for n, v in numbers.items()}, "n": result.n}
                )
    return {"label": label, "source": source, "printed": dict(printed_numbers), "cells": cells}


def _csv(header: tuple[str, ...], rows: Iterator[tuple[Any, ...]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return out.getvalue()


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"


def _short(value: float) -> float | None:
    """To the seven digits that results keep; None for no number, which JSON and CSV do not have."""
    return float(f"{value:.7g}") if math.isfinite(value) else None


def _parted(links: Iterator[Html]) -> Iterator[object]:
    for place, item in enumerate(links):
        yield from ((", ", item) if place else (item,))
