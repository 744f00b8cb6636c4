"""Everything that the pages are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from etude.report import number
from etude_studies.site.numbers import Numbers
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import runs_of
from etude_studies.thesis.contrasts import Contrast, contrasts
from etude_studies.thesis.kept import planned_seeds, price_s
from etude_studies.thesis.ledger import Claim, Entry, Ledger, Part
from etude_studies.thesis.part_verdicts import PartVerdict, part_verdict, weigh
from etude_studies.thesis.readings import Reading
from etude_studies.thesis.verdicts import Verdict


@dataclass(frozen=True)
class Study:
    """What the site shows.

    Attributes:
        ledger: claims and entries. verdicts: by claim. numbers: the results.
        readings: verdicts under other readings. what: a sentence on each run.
    """

    ledger: Ledger
    verdicts: Mapping[str, Verdict]
    numbers: Numbers
    readings: Sequence[Reading]
    what: Mapping[str, str]

    @cached_property
    def runs(self) -> tuple[str, ...]:
        """Runs that have a page: those that the ledger names, their motions over time, those of readings."""
        named = {*self.ledger.runs(), *(run for reading in self.readings for run in reading.replace.values())}
        there = (run for run in self.numbers.results.runs if run.removesuffix("t") in named)
        return tuple(sorted({*self.ledger.runs(), *there}))

    def readings_of(self, claim: Claim) -> list[tuple[Reading, Verdict]]:
        """Those that touch a claim."""
        return [
            (reading, reading.verdicts[claim.id]) for reading in self.readings if claim.id in reading.verdicts
        ]

    def depends(self, claim: Claim) -> tuple[str, ...]:
        """Names of the readings under which another of the three words of a decision stands."""
        decided = ("holds", "reversed", "tie")
        word = self.verdicts[claim.id].word
        others = ((reading, verdict.word) for reading, verdict in self.readings_of(claim))
        return tuple(
            reading.name for reading, other in others if {word, other} <= set(decided) and word != other
        )

    @cached_property
    def planned(self) -> Mapping[str, int]:
        """Seeds by run that count."""
        return planned_seeds(self.numbers.results)

    def price(self, id: str, seeds: int = 0, *, more: bool = False) -> str:
        """ "; 800 CPU seconds" for so many seeds of each run, 0 for as many as planned; "" if unknown.

        Args:
            more: for those not there yet.
        """
        runs = [run for run in runs_of(id) if run in self.numbers.results.runs]
        counts = {run: seeds or catalogue()[run].seeds for run in runs}
        spent = sum(price_s([run], n, self.numbers.results, more=more) for run, n in counts.items())
        return f"; {number(spent)} CPU seconds" if spent else ""

    def recorded(self, part: Part) -> PartVerdict:
        """The numbers of a quantity that is no test of a claim."""
        (contrast,) = contrasts(part, self.numbers, planned=self.planned)
        return part_verdict(weigh(0, part, contrast, None))

    def contrasts_of(self, claim: Claim, part: Part) -> tuple[Contrast, ...]:
        """The numbers of every seed that the verdict on a claim counts."""
        block = self.verdicts[claim.id].block
        return contrasts(part, self.numbers, planned=self.planned, seeds=claim.seeds, block=block)

    def names(self, claim: Claim) -> dict[str, str]:
        """Labels that the tables and figures behind a claim give to sources, the first of each."""
        labels: dict[str, str] = {}
        for id in claim.rests_on:
            for row in self.ledger.entry(id).rows:
                labels.setdefault(row.run, row.label)
        return labels

    def claims_of(self, entry: Entry) -> tuple[Claim, ...]:
        return self.ledger.claims_of(entry.id)
