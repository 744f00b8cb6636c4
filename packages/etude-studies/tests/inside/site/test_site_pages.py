"""The site as files: its numbers are those of results and verdicts, and nothing in it leads outside."""

from __future__ import annotations

import csv
import html.parser
import json
import math
import re
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote

import msgspec
import numpy as np
import polars as pl
import pytest
from made_up_study import JOINTS, MISSING, SEEDS, small_study
from scipy import stats

from etude.errors import EtudeError
from etude_studies.collected import Results
from etude_studies.site import facets
from etude_studies.site.build import build_site, pages
from etude_studies.site.claim_words import estimate, level
from etude_studies.site.context import Study
from etude_studies.site.dot_plot import Dot, Rule, dot_plot
from etude_studies.site.entry_table import table_of
from etude_studies.site.marks import style_of
from etude_studies.site.mathematics import plain, prose
from etude_studies.site.numbers import Numbers, Summary, summary
from etude_studies.site.words import WORDS, listed
from etude_studies.thesis.kept import kept_results, planned_seeds
from etude_studies.thesis.ledger import Ledger, Part, load_ledger
from etude_studies.thesis.part_verdicts import NOT_RUN, UNTESTED, PartVerdict
from etude_studies.thesis.readings import READINGS, Reading, readings
from etude_studies.thesis.verdict_file import shown
from etude_studies.thesis.verdicts import Verdict, judge

VOID = {"meta", "link", "input", "br"}
FLIPPED = "as if turned round"


class Page(html.parser.HTMLParser):
    """What a page links to, its anchors, words and chips; elements have to nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.links += [str(given[name]) for name in ("href", "src") if name in given]
        self.anchors |= {str(given["id"])} if "id" in given else set()
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", "".join(self.words))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    ledger, results, verdicts = small_study()
    turned = replace_word(verdicts)
    folder = tmp_path_factory.mktemp("site")
    what = {"A1": "dictionary & more, random"}
    first = build_site(ledger, verdicts, results, folder, sensitivity=[turned], what=what)
    assert first == folder / "index.html"
    return folder


def replace_word(verdicts: dict[str, Verdict]) -> Reading:
    """A reading under which C6.2-3 is turned round."""
    old = verdicts["C6.2-3"]
    word = "reversed" if old.word == "holds" else "holds"
    return Reading(FLIPPED, "R4", {"A1": "X5a"}, verdicts={"C6.2-3": msgspec.structs.replace(old, word=word)})


def read(folder: Path, name: str) -> str:
    return (folder / name).read_text(encoding="utf-8")


def test_the_counts_at_the_top_are_those_of_the_verdicts(site: Path) -> None:
    ledger, _, verdicts = small_study()
    found = re.findall(r'class="count (\w+)"[^>]*><b>(\d+)</b>', read(site, "index.html"))
    distinct = [claim for claim in ledger.claims if not claim.alias_of]
    assert len(distinct) < len(ledger.claims)
    expected = Counter(WORDS[shown(verdicts[claim.id])].name for claim in distinct)
    assert {name: int(n) for name, n in found if int(n)} == dict(expected)
    assert {"holds", "undecided", "untested", "notrun"} <= {*expected}
    assert sum(int(n) for _, n in found) == len(distinct)


def test_what_was_not_run_is_told_from_what_nothing_can_test() -> None:
    _, _, verdicts = small_study()
    waiting = [v for v in verdicts.values() if shown(v) == NOT_RUN]
    assert waiting
    assert all(v.word == UNTESTED for v in waiting)
    assert all(any(run in v.reason for run in MISSING) for v in waiting if v.parts)
    assert shown(verdicts["CA-6"]) == UNTESTED


def test_every_claim_has_a_line_and_a_page_with_its_verdict(site: Path) -> None:
    ledger, _, verdicts = small_study()
    index = Page(read(site, "index.html")).text
    for claim in ledger.claims:
        own = Page(read(site, f"{claim.id}.html")).text
        word = shown(verdicts[claim.id])
        for piece in claim.quote:
            assert piece in own
            assert piece in index
        assert f"{WORDS[word].mark} {word}" in own
        if claim.untestable:
            assert claim.untestable.rstrip(".")[1:] in own


def test_a_claims_page_has_the_verdicts_numbers_and_the_command(site: Path) -> None:
    _, _, verdicts = small_study()
    (part,) = verdicts["C6.2-3"].parts
    own = Page(read(site, "C6.2-3.html")).text
    assert f"{part.estimate:#.3g} [{part.low:#.3g}, {part.high:#.3g}]".replace("1.000", "1.00") in own
    assert f"{part.wins} of {SEEDS} seeds on the claimed side" in own
    assert "etude study run C6.2-3 " in own
    assert "0.946 in the thesis" in own


def test_the_table_has_printed_numbers_over_means_and_intervals_of_the_seeds(site: Path) -> None:
    _, results, _ = small_study()
    own = Page(read(site, "table-6.9.html")).text
    for told in ("0.9650", "1.8155", "1.3027", "3.5596"):
        assert told in own
    assert f"{np.mean([0.9650, 1.8155, 1.3027, 3.5596]):.3f}" in own
    for joint in JOINTS:
        x = np.array([*results.values("A6", "error", 6, "fourier", joint).values()])
        half = stats.sem(x) * stats.t.ppf(0.975, SEEDS - 1)
        mean, low, high = x.mean(), x.mean() - half, x.mean() + half
        assert f"{mean:#.3g}[{low:#.3g}, {high:#.3g}]" in own


def test_the_same_inputs_give_the_same_bytes(site: Path, tmp_path: Path) -> None:
    ledger, results, verdicts = small_study()
    again = build_site(
        ledger,
        verdicts,
        results,
        tmp_path,
        sensitivity=[replace_word(verdicts)],
        what={"A1": "dictionary & more, random"},
    ).parent
    names = {path.relative_to(site) for path in site.rglob("*") if path.is_file()}
    assert names == {path.relative_to(again) for path in again.rglob("*") if path.is_file()}
    assert all((site / name).read_bytes() == (again / name).read_bytes() for name in names)


def test_every_link_leads_to_a_file_of_the_folder(site: Path) -> None:
    found = {path.name: Page(path.read_text(encoding="utf-8")) for path in site.glob("*.html")}
    for name, own in found.items():
        for link in own.links:
            if link == "data:,":
                continue
            file, _, anchor = unquote(link).partition("#")
            assert ":" not in file, f"{name} leads outside: {link}"
            assert (site / (file or name)).is_file(), f"{name}: {link}"
            if anchor and "=" not in anchor:
                assert anchor in found[file or name].anchors, f"{name}: {link}"


def test_the_style_sheet_and_the_script_fetch_nothing(site: Path) -> None:
    for name in ("style.css", "site.js"):
        assert not re.search(r"https?:|@import|url\(|fetch\(|XMLHttp", read(site, name))


def test_settings_are_text_and_never_markup(site: Path) -> None:
    own = read(site, "run-A1.html")
    assert "&lt;b&gt;" in own
    assert "<b>" not in own.replace('"<b>"', "")[own.index("<pre>") :]
    assert "dictionary &amp; more" in own


def test_downloads_hold_the_numbers_of_the_results(site: Path) -> None:
    _, results, verdicts = small_study()
    with (site / "data" / "table-6.9.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["source"] == "A5" and row["part"] == "elbow"]
    stored = results.values("A5", "error", 6, "fourier", "elbow")
    got = {int(row["seed"]): float(row["value"]) for row in rows if row["k"] == "6"}
    assert got == pytest.approx(stored, rel=1e-6)
    told = json.loads(read(site / "data", "table-6.9.json"))
    cells = [cell for row in told["rows"] if row["source"] == "A5" for cell in row["cells"]]
    (cell,) = (one for one in cells if one["column"] == "elbow")
    assert cell["mean"] == pytest.approx(np.mean([*stored.values()]), rel=1e-6)
    assert told["verdicts"]["C6.2-2"] == verdicts["C6.2-2"].word


def test_a_claims_download_averages_to_its_estimate(site: Path) -> None:
    _, _, verdicts = small_study()
    with (site / "data" / "C6.2-2.csv").open(encoding="utf-8") as file:
        x = [float(row["x"]) for row in csv.DictReader(file)]
    assert len(x) == SEEDS
    assert np.exp(np.mean(x)) == pytest.approx(verdicts["C6.2-2"].parts[0].estimate, rel=1e-5)


def test_every_point_of_the_seeds_names_its_spec(site: Path) -> None:
    _, results, _ = small_study()
    own = read(site, "table-6.9.html")
    for seed, name in results.made("A5")["hashes"].items():
        assert re.search(rf"seed {seed}: [\d.]+, spec {name}</title>", own)


def test_a_verdict_that_turns_under_another_reading_is_said_to_depend_on_it(site: Path) -> None:
    assert f"depends on: {FLIPPED}" in Page(read(site, "index.html")).text
    assert f"depends on: {FLIPPED}" in Page(read(site, "C6.2-3.html")).text
    assert "R4: " + FLIPPED in Page(read(site, "table-6.9.html")).text
    assert "depends on" not in Page(read(site, "C6.2-2.html")).text


def test_runs_that_are_missing_are_named(site: Path) -> None:
    assert "Not run yet: DP4." in Page(read(site, "protocols.html")).text
    ledger, results, verdicts = small_study()
    fewer = Results({k: v for k, v in results.tables.items() if k != "A6"}, results.descriptions)
    study = Study(ledger, verdicts, Numbers(fewer), (), {})
    own = dict(pages(study))
    assert "Not run yet: A6." in Page(own["table-6.9.html"]).text
    assert "Not run yet" not in Page(own["table-6.10.html"]).text.split("Protocol")[0]


def test_without_any_result_the_whole_ledger_still_has_its_pages() -> None:
    ledger, nothing = load_ledger(), Results({}, {})
    verdicts = judge(ledger, nothing)
    own = dict(pages(Study(ledger, verdicts, Numbers(nothing), (), {})))
    for item in (*ledger.entries, *ledger.claims):
        Page(own[f"{item.id}.html"])
    counted = Counter(shown(v) for v in verdicts.values())
    assert {*counted} == {UNTESTED, NOT_RUN}
    distinct = [claim for claim in ledger.claims if not claim.alias_of]
    assert f"Of {len(distinct)} distinct claims 0 are answered" in Page(own["index.html"]).text


def test_verdicts_that_are_missing_are_judged(tmp_path: Path) -> None:
    ledger, results, verdicts = small_study()
    few = {name: table.filter(table["seed"] < 2) for name, table in results.tables.items() if name == "B0"}
    build_site(ledger, {}, Results(few, results.descriptions), tmp_path, what={})
    assert "not run yet" in Page(read(tmp_path, "C6.2-2.html")).text
    assert shown(verdicts["C6.2-2"]) != NOT_RUN


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    taken = tmp_path / "file"
    taken.write_text("")
    ledger, results, verdicts = small_study()
    with pytest.raises(EtudeError, match="cannot be written") as caught:
        build_site(ledger, verdicts, results, taken / "site", what={})
    assert caught.value.next_step


def test_motions_over_time_are_drawn_where_they_are_kept(site: Path) -> None:
    own = read(site, "figure-6.13.html")
    assert re.findall(r'data-plot="trace (\w+)"', own) == list(JOINTS)
    curves = re.findall(r'class="line mark (\w+)', own)
    assert curves == ["c8", style_of(0).colour, style_of(1).colour] * len(JOINTS), "both arms in each drawing"
    assert "Random trajectories" in Page(own).text
    ledger, results, verdicts = small_study()
    kept = {name: table for name, table in results.tables.items() if not name.endswith("t")}
    own = dict(pages(Study(ledger, verdicts, Numbers(Results(kept, results.descriptions)), (), {})))
    assert "No motions over time are kept yet" in own["figure-6.13.html"]


def test_numbers_of_another_scale_are_printed_and_not_drawn(site: Path) -> None:
    own = read(site, "table-6.11.html")
    assert "26.9634" in own
    assert "printed mark" not in own
    assert "printed mark" in read(site, "table-6.10.html")


def test_a_dot_lies_where_its_number_is() -> None:
    dots = [Dot(str(v), Summary(v, v, v, 1), None, style_of(0)) for v in (1.0, 2.0, 4.0)]
    for log, steps in ((False, 2.0), (True, 1.0)):
        drawn = dot_plot("", dots, axis="", log=log)
        x = [float(v) for v in re.findall(r'class="dot mark c1" d="M([\d.]+),', drawn)]
        assert (x[2] - x[1]) / (x[1] - x[0]) == pytest.approx(steps, abs=0.01)


def test_a_line_far_away_is_named_at_the_edge_and_leaves_the_rows_their_room() -> None:
    dots = [Dot("row", Summary(1.0, 0.9, 1.1, 3), None, style_of(0))]
    plain, far = (dot_plot("", dots, rules, axis="") for rules in ([], [Rule("PD alone", 30.0)]))
    place = r'class="dot mark c1" d="M([\d.]+),'
    assert re.search(place, plain)[1] == re.search(place, far)[1]
    assert "PD alone 30.0 ▸" in far
    assert 'class="line base mark"' not in far


def test_a_summary_leaves_out_what_is_not_finite() -> None:
    found = summary({0: 1.0, 1: float("nan"), 2: 3.0})
    low, high = stats.t.interval(0.95, 1, 2.0, 1.0)
    assert found == Summary(2.0, pytest.approx(low), pytest.approx(high), 2)
    assert summary({0: float("nan")}) is None


def test_lengths_have_a_geometric_mean_whose_interval_stays_above_zero() -> None:
    lengths = {0: 0.01, 1: 1.0, 2: 100.0}
    low, high = stats.t.interval(0.95, 2, 0.0, math.log(100.0) / math.sqrt(3.0))
    want = Summary(pytest.approx(1.0), pytest.approx(math.exp(low)), pytest.approx(math.exp(high)), 3)
    assert summary(lengths, logs=True) == want
    assert load_ledger().entry("table-6.2").in_logs


def test_formulas_are_mathml_on_pages_and_letters_elsewhere() -> None:
    words = "it is $O(nm^2)$ & more"
    power = "<msup><mi>m</mi><mrow><mn>2</mn></mrow></msup>"
    inside = f"<mi>O</mi><mo>(</mo><mi>n</mi>{power}<mo>)</mo>"
    assert prose(words) == f"it is <math>{inside}</math> &amp; more"
    assert plain(words) == "it is O(nm²) & more"


def test_claims_are_filtered_by_what_they_rest_on() -> None:
    ledger = load_ledger()
    own = facets.of_claim(ledger, ledger.claim("C6.2-3"))
    assert own["robot"] == ("arm",)
    assert own["model"] == ("dictionary", "full GPR")
    assert own["motions"] == ("random",)
    flights = facets.of_claim(ledger, ledger.claim("C5.2-1a"))
    assert (flights["robot"], flights["motions"]) == (("quadrotor",), ("random", "maximum variance"))
    assert facets.of_claim(ledger, ledger.claim("C7-4"))["chapter"] == ("7",)
    chapters = {name for claim in ledger.claims for name in facets.of_claim(ledger, claim)["chapter"]}
    assert chapters <= {*facets.ORDER["chapter"]}


def test_readings_touch_only_claims_whose_runs_they_exchange() -> None:
    ledger, results, _ = small_study()
    planned, one = dict.fromkeys(results.runs, SEEDS), Reading("x", "", {"A5": "X2"})
    (own,) = readings(ledger, results, planned=planned, among=[one])
    assert "C6.2-2" in own.verdicts
    assert "C6.2-3" not in own.verdicts


def reading(name: str) -> Reading:
    return next(own for own in READINGS if own.name == name)


def test_a_reading_exchanges_every_side_of_a_comparison() -> None:
    """A1 on other data stands beside arms of the same data, or beside none."""
    drawn, amplitude = (
        reading("random trajectories drawn again"),
        reading("random amplitudes, flights of random size"),
    )
    for own, other in ((drawn, "X1"), (amplitude, "X2")):
        assert own.replace["A1"] == other
        assert {"A2", "A3", "A5", "A6", "A7", "S1", "S9"} <= {*own.replace}
        assert not {"B0", "B1", "Y1", "K1"} & {*own.replace}
    assert (amplitude.replace["Q1"], amplitude.replace["P1"]) == ("Q2", "P3")
    assert "Q4" not in amplitude.replace, "its first flight is common to all arms"
    steps = reading("steps are evaluations of the likelihood").replace
    assert [steps[run] for run in ("A1", "A3", "S1", "S2")] == ["X5a", "X5b", "X6a", "X6b"]
    assert "A0" not in steps, "it has none"
    arms = [f"A{i}" for i in range(1, 8)] + [f"S{i}" for i in range(1, 10)]
    assert len({steps[run] for run in arms if steps[run].isalnum()}) == len(arms), "every row with steps"
    assert [steps[run] for run in ("A2", "A6", "A7", "S4", "S9")] == ["X5c", "X5f", "X5g", "X6d", "X6i"]
    assert steps["X8"] == "X8 (so read)"
    found = {name for own in READINGS for name in own.replace.values() if name.isalnum()}
    assert found >= {
        "X1",
        "X2",
        "X3",
        "X4",
        "X7",
        "X8",
        "X11",
        "X13",
        "Q5",
        "P4",
        "Q6d",
        "Q8u",
        "P5d",
        "DP1",
        "DP4",
    }


def test_readings_of_the_committed_results_have_both_sides_or_were_not_run() -> None:
    """Figures found by a reader of the committed tables alone."""
    whole, results = load_ledger(), kept_results()
    asked = tuple(whole.claim(id) for id in ("C6.1.1-1", "C5.2-1a", "C6.3.1-1"))
    names = [
        "random amplitudes, flights of random size",
        "five harmonics, extreme test flights",
        "one test motion common to all seeds",
    ]
    ledger, among = Ledger(asked, whole.entries, whole.ambiguities), [reading(name) for name in names]
    other, extreme, common = readings(ledger, results, planned=planned_seeds(results), among=among)
    assert shown(other.verdicts["C6.1.1-1"]) == NOT_RUN
    assert "A2 (so read)" in other.verdicts["C6.1.1-1"].reason
    (part,) = extreme.verdicts["C5.2-1a"].parts
    assert (part.estimate, part.wins, part.seeds) == (pytest.approx(0.704, abs=5e-4), 57, 58)
    assert "C6.3.1-1" not in extreme.verdicts
    (part,) = common.verdicts["C6.3.1-1"].parts
    assert (part.estimate, part.wins) == (pytest.approx(0.813, abs=5e-4), 20)


def test_numbers_in_words() -> None:
    assert listed([4, 5, 6]) == "4 to 6"
    assert listed([4, 6]) == "4 and 6"
    assert listed(["a", "b", "c"]) == "a, b and c"


def test_a_cell_with_fewer_seeds_than_its_row_says_so() -> None:
    ledger, results, verdicts = small_study()
    table = results.tables["A5"]
    lost = (table["part"] == "wrist") & (table["k"] == 6) & (table["seed"] < 3)
    value = pl.when(pl.Series(lost)).then(float("nan")).otherwise(pl.col("value")).alias("value")
    broken = {**results.tables, "A5": table.with_columns(value)}
    numbers = Numbers(Results(broken, results.descriptions))
    own = dict(pages(Study(ledger, verdicts, numbers, (), {})))["table-6.9.html"]
    assert own.count(f'<span class="interval">{SEEDS - 3} of {SEEDS} seeds</span>') == 1


def test_every_row_is_compared_with_the_one_that_its_table_names(site: Path) -> None:
    """Ratios are those of the numbers; a word waits for all seeds that the table plans."""
    _, results, _ = small_study()
    own = Page(read(site, "beyond-methods-arm.html")).text
    assert "Compared with dictionary by error (thesis)" in own
    for run in ("A6", "M1:network"):
        pair = [results.values(source, "error", 6, "fourier", "mean") for source in (run, "A1")]
        x = np.log([*pair[0].values()]) - np.log([*pair[1].values()])
        assert f"{np.exp(x.mean()):.3g}" in own
        assert f"{np.count_nonzero(x < 0)} of {SEEDS} seeds" in own
    compared = read(site, "beyond-methods-arm.html").partition("Compared with")[2].partition("</table>")[0]
    entry = load_ledger().entry("beyond-methods-arm")
    assert entry.seeds > SEEDS
    assert compared.count(NOT_RUN) == len(entry.rows) - 1  # all but the one that they are compared with


def test_what_no_seed_reached_is_not_called_not_run() -> None:
    """Seconds until an error that is never reached are a result."""
    entry = load_ledger().entry("beyond-seconds")
    asked = msgspec.structs.replace(entry, columns=("0.5", "0.3"), rows=entry.rows[:1])
    never = {"0.5": {0: math.nan, 1: 120.0}, "0.3": {0: math.nan, 1: math.nan}}

    class Told:
        def cell(self, entry, source, column, k, test=None):
            return never[column]

        def summary(self, entry, source, column, k, test=None):
            return summary(self.cell(entry, source, column, k))

    study: Any = SimpleNamespace(numbers=Told(), what={})
    text = Page(str(table_of(study, asked))).text
    assert "1 of 2 seeds" in text
    assert "none of 2 seeds" in text
    assert "not run" not in text
    assert Dot("slow", None, None, style_of(0), asked=2).value_text == "none of 2 seeds"
    assert Dot("slow", summary(never["0.5"]), None, style_of(0), asked=2).value_text.endswith(", 1 of 2")


def test_a_sum_that_is_zero_but_for_rounding_is_written_as_zero() -> None:
    found = PartVerdict(part=0, word="not decided", log=False, estimate=5.5e-18, low=-0.1, high=0.1)
    assert estimate(found) == "0 [−0.100, 0.100]"


def test_values_and_ranks_are_given_beside_their_distance_from_a_bound() -> None:
    found = PartVerdict(part=0, word="holds", log=False, estimate=-0.35, low=-0.4, high=-0.3)
    for statistic in ("value", "rank"):
        part = Part(statistic=statistic, claim="less", measure="error", a="T1", bound=1.3)
        assert level(part, found) == "measured 0.950 [0.900, 1.00]"
    assert not level(Part(statistic="ratio", claim="less", measure="error", a="A1", b="A5"), found)
