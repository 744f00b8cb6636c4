"""The ledger of the thesis: its claims, figures and tables as data, from `claims.toml` and `tables.toml`.

A claim says which statistic of which runs answers it; an entry is one figure or table, with the numbers that
the thesis printed. Both files are checked as a whole when they are read, so that nothing is left without an
answer and nothing is answered twice.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from etude.errors import UsageError
from etude_studies.thesis import ledger_checks as checks

HERE = Path(__file__).parent
CLAIMS, TABLES = "claims.toml", "tables.toml"

Kind = Literal["own", "mech", "obs", "cited", "alias"]
Family = Literal["", "chapter5", "chapter6"]
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
Item = TypeVar("Item")


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Frozen; a key that is no field is refused."""


class Part(_Strict, frozen=True):
    """One number x a seed, and what is claimed of its mean.

    Attributes:
        statistic: how x is made of the measure M; logs are natural.
            ratio: mean over `at` of log(M_a / M_b). ratio_each: the same at each k alone, and all must hold.
            rises: share of steps k -> k + 1 within `at` at which M_a rises by > 2 %, minus that of b if given.
            slope: mean decrease of log M_a per trajectory between at[0] and at[1], minus that of b (a, if not
            given) between against[0] and against[1]; without `against` and b the decrease itself.
            value: mean over `at` of M_a, minus `bound` (log: of the logs of both).
            gap: |log(M_a / M_b)| - |log(M_c / M_d)|, or minus log(bound) without c.
            shrinks: |log(M_a / M_b)| at at[0] minus that at at[-1].
            rank: rank of M_a among `among` (1 = least), minus `bound`.
            reach: log of the trajectories that a needs to reach b's value at at[-1], minus log at[-1].
            spread: log(largest / smallest M over `among`) - log(bound).
            largest, smallest: log of M_a of `part` over the largest (smallest) of the other parts.
        claim: x is "less" or "more" than 0, or "equal": |x| within log `margin`.
        measure, test, part: columns of the results; `part` a joint, a command or "mean".
        a, b, c, d, among: sources, "RUN" or "RUN:model".
        at, against: numbers of trajectories learned, k; of timings the numbers of points.
        printed: M_a / M_b by the numbers that the thesis printed, where it did.
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
        family: within which several tests are corrected for; "" for kinds other than own.
        rests_on: ids of entries.
        seeds: planned, per run.
        combine: whether all parts must hold, or any.
        thesis: its own numbers, in words. note: how it is tested, and what that leaves out.
        contradicts: what else in the thesis says otherwise. untestable: why no part can answer it.
        simulated: a claim about hardware, answered in simulation.
    """

    id: str
    section: str
    quote: tuple[str, ...]
    kind: Kind
    family: Family = ""
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


class Row(_Strict, frozen=True):
    """One row of a table, or curve of a figure.

    Attributes:
        run: its source. at: its k, where they are not the entry's. seeds: where fewer than the entry's.
        printed: the thesis's numbers, one a column other than "mean"; empty where it printed none.
    """

    label: str
    run: str
    at: tuple[int, ...] = ()
    seeds: int = 0
    printed: tuple[float, ...] = ()


class Entry(_Strict, frozen=True):
    """One figure or table.

    Attributes:
        id: "table-6.9", "figure-6.10". title: its caption.
        kind: table, curve (over k), trace (over time) or bars.
        measure, test, part: columns of the results; `part` only where all columns are of one joint.
        at: numbers of trajectories learned, k.
        lines: sources that every table carries beside its rows. beside: the default protocol's runs.
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
    """Claims, entries and ambiguities, in the order of the thesis."""

    claims: tuple[Claim, ...]
    entries: tuple[Entry, ...]
    ambiguities: tuple[Ambiguity, ...]

    def claim(self, id: str) -> Claim:
        """The claim of that id. UsageError with the nearest if there is none."""
        return checks.found(self._claims, id, "claim")

    def entry(self, id: str) -> Entry:
        """The figure or table of that id. UsageError with the nearest if there is none."""
        return checks.found(self._entries, id, "figure or table")

    def claims_of(self, entry: str) -> tuple[Claim, ...]:
        """Claims that rest on the entry of that id."""
        return tuple(claim for claim in self.claims if entry in claim.rests_on)

    def aliases_of(self, claim: str) -> tuple[str, ...]:
        """Ids of claims that say the same as the claim of that id."""
        return tuple(other.id for other in self.claims if claim in other.alias_of)

    def sources(self) -> tuple[str, ...]:
        """Every source that a claim or an entry names, "RUN" or "RUN:model", sorted."""
        parts = (part.sources for claim in self.claims for part in claim.parts)
        return tuple(sorted({one for own in (*parts, *(e.sources for e in self.entries)) for one in own}))

    def runs(self) -> tuple[str, ...]:
        """The runs of `sources`, sorted."""
        return tuple(sorted({source.partition(":")[0] for source in self.sources()}))

    @cached_property
    def _claims(self) -> dict[str, Claim]:
        return {claim.id: claim for claim in self.claims}

    @cached_property
    def _entries(self) -> dict[str, Entry]:
        return {entry.id: entry for entry in self.entries}


def load_ledger(folder: Path = HERE) -> Ledger:
    """Claims and entries of the two files of `folder`, checked together.

    Raises:
        UsageError: a file that is missing or no TOML; an unknown key or statistic; an alias with parts or of
            an alias; an own claim without a family; a figure or table that is missing or there twice; a name
            that nothing bears. File and id are said.
    """
    claims, tables = _read(folder / CLAIMS, ("claim",)), _read(folder / TABLES, ("entry", "ambiguity"))
    ledger = Ledger(
        claims=_made(Claim, claims, "claim", CLAIMS),
        entries=_made(Entry, tables, "entry", TABLES),
        ambiguities=_made(Ambiguity, tables, "ambiguity", TABLES),
    )
    checks.check(ledger)
    return ledger


def _read(path: Path, keys: tuple[str, ...]) -> dict[str, Any]:
    """The arrays of tables of a file."""
    import tomllib

    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
        step = "Restore it from a copy of the package."
        raise UsageError(f"cannot be read: {problem}", where=path.name, next_step=step) from None
    for key in (*found, *keys):
        if key not in keys or not isinstance(found.get(key), list):
            step = f"Write {' and '.join(f'[[{key}]]' for key in keys)} only."
            raise UsageError(f"{key!r} is missing, or not expected here", where=path.name, next_step=step)
    return found


def _made(kind: type[Item], tables: dict[str, Any], key: str, file: str) -> tuple[Item, ...]:
    """Values of a kind from an array of tables; what msgspec refuses is said with the id."""
    made = []
    for number, table in enumerate(tables[key], start=1):
        id = table.get("id", f"{key} {number}") if isinstance(table, dict) else f"{key} {number}"
        try:
            made.append(msgspec.convert(table, kind))
        except msgspec.ValidationError as problem:
            step = f"Keys and values are described in {kind.__name__} of ledger.py."
            raise UsageError(str(problem), where=f"{file}, {id}", next_step=step) from None
    return tuple(made)
