"""Claims, figures, tables and ambiguities of the thesis: what one of each is, key by key of the two files."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cached_property
from typing import Literal, TypeVar

import msgspec

from etude.errors import UsageError

Item = TypeVar("Item")

Kind = Literal["own", "mech", "obs", "cited", "alias"]
Statistic = Literal[
    "ratio",
    "ratio_each",
    "rises",
    "slope",
    "value",
    "gap",
    "shrinks",
    "rank",
    "reach",
    "spread",
    "largest",
    "smallest",
]
Direction = Literal["less", "more", "equal"]
LENGTH = "length"
"""The measure whose columns are inputs of a kernel: lengths span decades."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Frozen; a key that is no field is refused."""


class Part(_Strict, frozen=True):
    """One number x a seed, and what is claimed of its mean.

    Attributes:
        statistic: how x is made of the measure M; logs are natural.
            ratio: mean over `at` of log(M_a / M_b). ratio_each: the same at each k alone, and all must hold.
            rises: share of steps k -> k + 1 within `at` at which M_a rises by > 2 %, minus that of b.
            slope: mean decrease of log M_a per trajectory between at[0] and at[1], minus that of b (a, if not
            given) between against[0] and against[1]; without `against` and b the decrease itself.
            value: mean over `at` of M_a, minus `bound` (log: of the logs of both).
            gap: size of log(M_a / M_b) minus that of log(M_c / M_d), or minus log(bound) without c; the size
            of an effect is |its mean over seeds|: each seed's number has the sign of that mean.
            shrinks: size of log(M_a / M_b) at at[0] minus that at at[-1].
            rank: rank of M_a among `among` (1 = least), minus `bound`.
            reach: log of the trajectories that a needs to reach b's value at at[-1], minus log of those that
            b needs to reach a's.
            spread: log(M_a / M_b) - log(bound), a and b those of `among` with the largest and the smallest
            mean over seeds.
            largest, smallest: log of M_a of `part` over the largest (smallest) of the other parts.
        claim: x is "less" or "more" than 0, or "equal": |x| within `margin`, a factor where x is a logarithm.
        measure, test, part: columns of the results; `part` a joint, a command or "mean".
        a, b, c, d, among: sources, "RUN" or "RUN:model".
        at, against: numbers of trajectories learned, k; of timings the numbers of points.
        printed: M_a / M_b of a ratio, by the numbers that the thesis printed, where it did.
    """

    statistic: Statistic
    claim: Direction
    measure: str
    a: str = ""
    b: str = ""
    c: str = ""
    d: str = ""
    among: tuple[str, ...] = ()
    at: tuple[int, ...] = ()
    against: tuple[int, ...] = ()
    test: str = ""
    part: str = "mean"
    bound: float | None = None
    log: bool = False
    margin: float = 1.15
    printed: float | None = None

    @property
    def sources(self) -> tuple[str, ...]:
        """All that this part reads, each once, in the order a, b, c, d, among."""
        return tuple(dict.fromkeys(filter(None, (self.a, self.b, self.c, self.d, *self.among))))


class Claim(_Strict, frozen=True):
    """One sentence of the thesis that something can be asked about.

    Attributes:
        id: "C<section>-<number>"; "CA-<number>" in the abstract.
        quote: the sentence, or pieces of it, word for word.
        kind: own (the thesis's result), mech (its explanation), obs (one run described), cited (others'
            result), alias (says again what the claims of `alias_of` say).
        rests_on: ids of entries; own claims with the same first one are corrected together.
        seeds: planned of the run with the fewest among those it reads.
        combine: whether all parts must hold, or any.
        thesis: its own numbers, in words. note: how it is tested, and what that leaves out.
        contradicts: what else in the thesis says otherwise. untestable: why no part can answer it.
        simulated: a claim about hardware, answered in simulation.
    """

    id: str
    section: str
    quote: tuple[str, ...]
    kind: Kind
    rests_on: tuple[str, ...] = ()
    alias_of: tuple[str, ...] = ()
    seeds: int = 20
    combine: Literal["all", "any"] = "all"
    thesis: str = ""
    note: str = ""
    contradicts: str = ""
    untestable: str = ""
    simulated: bool = False
    parts: tuple[Part, ...] = msgspec.field(default=(), name="part")


class Why(_Strict, frozen=True):
    """What was recorded beside the comparisons of claims that are reversed.

    Attributes:
        claims: ids. words: what the numbers say together.
        parts: recorded quantities, each on the side that the words name; none is a test of a claim.
    """

    claims: tuple[str, ...]
    words: str
    parts: tuple[Part, ...] = msgspec.field(name="part")


class Row(_Strict, frozen=True):
    """One row of a table, or curve of a figure.

    Attributes:
        run: its source. at: its k, where they are not the entry's.
        printed: the thesis's numbers, one a column other than "mean"; empty where it printed none.
    """

    label: str
    run: str
    at: tuple[int, ...] = ()
    printed: tuple[float, ...] = ()


class Entry(_Strict, frozen=True):
    """One figure or table.

    Attributes:
        id: "table-6.9", "figure-6.10". title: its caption.
        kind: table, curve (over k), trace (over time) or bars.
        measure, test, part: columns of the results; `part` only where all columns are of one joint.
        at: numbers of trajectories learned, k.
        lines: sources that every table carries beside its rows. beside: the default protocol's runs.
        against: the source of the row that all others are compared with, by the mean or the first column.
        sensitivity: runs that show what another reading changes. ambiguous: ids of ambiguities.
        printed_words: what the thesis says of a picture whose numbers it does not print.
    """

    id: str
    title: str
    section: str
    kind: Literal["table", "curve", "trace", "bars"]
    measure: str
    unit: str
    at: tuple[int, ...]
    columns: tuple[str, ...]
    test: str
    seeds: int
    part: str = ""
    lines: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    against: str = ""
    sensitivity: tuple[str, ...] = ()
    ambiguous: tuple[str, ...] = ()
    printed_words: str = ""
    note: str = ""
    rows: tuple[Row, ...] = msgspec.field(default=(), name="row")

    @property
    def command(self) -> str:
        """What makes it again."""
        return f"etude study run {self.id}"

    @property
    def in_logs(self) -> bool:
        """Whether its numbers span decades: geometric means, logarithmic axes."""
        return self.measure == LENGTH

    @property
    def sources(self) -> tuple[str, ...]:
        """All that this entry shows, each once."""
        rows = (row.run for row in self.rows)
        return tuple(dict.fromkeys((*rows, *self.lines, *self.beside, *self.sensitivity)))


class Ambiguity(_Strict, frozen=True):
    """What the thesis leaves open, and how it is read here."""

    id: str
    what: str
    resolution: str


class Ledger(msgspec.Struct, frozen=True, dict=True):
    """Claims, entries and ambiguities, in the order of the thesis; and why claims are reversed."""

    claims: tuple[Claim, ...]
    entries: tuple[Entry, ...]
    ambiguities: tuple[Ambiguity, ...]
    whys: tuple[Why, ...] = ()

    def claim(self, id: str) -> Claim:
        """The claim of that id. UsageError with the nearest if there is none."""
        return found(self._claims, id, "claim")

    def entry(self, id: str) -> Entry:
        """The figure or table of that id. UsageError with the nearest if there is none."""
        return found(self._entries, id, "figure or table")

    def claims_of(self, entry: str) -> tuple[Claim, ...]:
        """Claims that rest on the entry of that id."""
        return tuple(claim for claim in self.claims if entry in claim.rests_on)

    def aliases_of(self, claim: str) -> tuple[str, ...]:
        """Ids of claims that say the same as the claim of that id."""
        return tuple(other.id for other in self.claims if claim in other.alias_of)

    def why(self, claim: str) -> Why | None:
        """Why the claim of that id is reversed."""
        return next((one for one in self.whys if claim in one.claims), None)

    def sources(self) -> tuple[str, ...]:
        """Every source that a claim or an entry names, "RUN" or "RUN:model", sorted."""
        parts = (part.sources for claim in self.claims for part in claim.parts)
        return tuple(sorted({one for named in (*parts, *(e.sources for e in self.entries)) for one in named}))

    def runs(self) -> tuple[str, ...]:
        """The runs of `sources`, sorted."""
        return tuple(sorted({source.partition(":")[0] for source in self.sources()}))

    @cached_property
    def _claims(self) -> dict[str, Claim]:
        return {claim.id: claim for claim in self.claims}

    @cached_property
    def _entries(self) -> dict[str, Entry]:
        return {entry.id: entry for entry in self.entries}


def found(items: Mapping[str, Item], id: str, what: str) -> Item:
    """The item of that id. UsageError with the nearest ids, or all of them, if there is none."""
    if id in items:
        return items[id]
    near = difflib.get_close_matches(id, items, 3)
    step = f"Did you mean {' or '.join(near)}?" if near else f"There are {', '.join(items)}."
    raise UsageError(f"there is no {what} {id}", next_step=step)
