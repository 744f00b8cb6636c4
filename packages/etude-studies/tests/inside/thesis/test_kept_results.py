"""What is committed is what the committed code produces, and verdicts and pages are of what is committed."""

from __future__ import annotations

import math
from pathlib import Path

import polars as pl
import pytest

from etude.campaign import preset_config
from etude.errors import UsageError
from etude_studies.collected import Results
from etude_studies.measured import KEYS, comparable
from etude_studies.run_file import result_path
from etude_studies.spec import Spec, run_one
from etude_studies.thesis.again import STEADY
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import ledger
from etude_studies.thesis.contrasts import contrasts
from etude_studies.thesis.kept import (
    FOLDER,
    VERDICTS,
    kept_results,
    kept_verdicts,
    planned_seeds,
    renew,
    unpack,
    verdicts_of,
)
from etude_studies.thesis.part_verdicts import DEPENDS
from etude_studies.thesis.statistics import interval
from etude_studies.thesis.verdicts import changed, from_json, to_json
from etude_studies.world import World

FIRST_ROUND = ("A1", "A5", "A6", "A7", "S1", "S5", "DP1")
"""Runs whose first round is computed again alone: a shorter run of the same settings begins the same."""
BESIDE = ("A1", "A7", "DP1")
"""Of these, the runs beside which rigid bodies are identified."""
IDENTIFIED = pl.col("model").str.starts_with("identified")
"""Lines that are not the run's own: Étude's identification of the day on the same logs."""
WHOLE = ("B1", "K1", "mA5", "mA7", "mS1", "mS5", "mDP1", "mQ1")
"""Each way of learning and designing, in miniature; the runs that take long are slow tests."""
LONG = "mP2"
REL = 0.03
"""Training ends a little elsewhere with another BLAS: 25 line searches carry its rounding on. Another seed,
setting or test changes most figures by tens of per cent."""


def computed(spec: Spec) -> pl.DataFrame:
    return run_one(spec, {own.hash: run_one(own, {}) for own in spec.needs})


def first_round(run: str) -> pl.DataFrame:
    return computed(shortened(catalogue()[run].spec(0), rounds=1))


def shortened(spec: Spec, **keys: object) -> Spec:
    return Spec(spec.function, {**spec.settings, **keys}, spec.seed, spec.needs)


def compared(run: str, table: pl.DataFrame, least: int) -> None:
    kept = kept_results().tables[run].filter(pl.col("seed") == 0).drop("seed")
    both = comparable(table).join(kept, on=KEYS, suffix="_kept", how="left")
    assert both["value_kept"].is_not_null().all(), "a figure is computed that is not committed"
    steady = both.filter(pl.col("measure").is_in(STEADY), pl.col("value").is_finite())
    assert len(steady) >= least
    for row in steady.iter_rows(named=True):
        assert row["value"] == pytest.approx(row["value_kept"], rel=REL, abs=1e-6), row


@pytest.mark.slow
@pytest.mark.parametrize("run", FIRST_ROUND)
def test_a_first_round_is_computed_again(run: str) -> None:
    compared(run, first_round(run).filter(~IDENTIFIED), 15)


@pytest.mark.slow
@pytest.mark.xfail(
    reason="identified before parameters were shared; made again by: etude study run A1, A7, DP1, "
    "3400 CPU seconds in all; etude study report --update",
    raises=AssertionError,
    strict=True,
)
@pytest.mark.parametrize("run", BESIDE)
def test_lines_identified_beside_it_are_computed_again(run: str) -> None:
    compared(run, first_round(run).filter(IDENTIFIED), 5)


@pytest.mark.parametrize("run", [*WHOLE, pytest.param(LONG, marks=pytest.mark.slow)])
def test_a_whole_run_is_computed_again(run: str) -> None:
    compared(run, computed(catalogue()[run].spec(0)), 5)


def test_every_committed_run_is_of_the_catalogue_and_of_its_spec() -> None:
    results = kept_results()
    assert set(results.runs) <= set(catalogue())
    for run in results.runs:
        hashes = results.made(run)["hashes"]
        assert {int(seed): value for seed, value in hashes.items()} == {
            seed: catalogue()[run].spec(seed).hash for seed in results.seeds(run)
        }, f"{run} has other settings than its results"


def test_every_run_says_where_it_comes_from() -> None:
    for run in kept_results().runs:
        made = kept_results().made(run)
        assert made["commit"]
        assert "dirty" not in made["commit"], run
        assert made["versions"]["etude"]
        assert made["machine"]["cpu"]


def test_the_verdicts_are_of_the_committed_results() -> None:
    again = verdicts_of(kept_results())
    assert not changed(kept_verdicts(), again)
    assert (FOLDER / VERDICTS).read_text(encoding="utf-8") == to_json(again)


def test_every_reversed_claim_has_a_reason_that_the_records_bear_out() -> None:
    own, results, verdicts = ledger(), kept_results(), kept_verdicts()
    for claim in own.claims:
        if verdicts[claim.id].word == "reversed" and not claim.alias_of:
            assert own.why(claim.id), claim.id
    for why in own.whys:
        for part in why.parts:
            (found,) = contrasts(part, results)
            low, high = interval(list(found.x.values()))
            assert (low > 0.0) if part.claim == "more" else (high < 0.0), (why.words, part)


def test_seeds_beyond_the_plan_are_not_planned() -> None:
    rows = {"seed": list(range(30)), "value": [0.0] * 30}
    more = Results({"K1": pl.DataFrame(rows), "elsewhere": pl.DataFrame(rows)}, {})
    assert planned_seeds(more) == {"K1": catalogue()["K1"].seeds, "elsewhere": 30}


def test_no_reading_of_a_step_is_the_headline() -> None:
    """Five steps are better than 25 where a step is an evaluation, and worse where it is a line search."""
    own = kept_verdicts()["C6.1.2-2"]
    assert own.word == DEPENDS
    assert [part.word for part in own.parts] == ["reversed"]
    assert "steps are line searches: reversed; steps are evaluations of the likelihood: holds" in own.reason
    x6 = [kept_results().values(run, "error", 4, "fourier") for run in ("X6a", "X6b")]
    ratios = [math.log(x6[0][seed] / x6[1][seed]) for seed in range(20)]
    assert interval(ratios)[1] < 0.0


def test_committed_results_become_a_store_again(tmp_path: Path) -> None:
    runs = [catalogue()[name] for name in ("B1", "K1")]
    count = unpack(runs, tmp_path, kept_results())
    assert count == sum(len(kept_results().seeds(run.name)) for run in runs) > 0
    assert all(result_path(tmp_path, run.spec(0)).exists() for run in runs)
    assert unpack(runs, tmp_path, kept_results()) == 0


def test_results_of_a_store_are_renewed_as_they_were(tmp_path: Path) -> None:
    runs = [catalogue()[name] for name in ("B1", "K1")]
    unpack(runs, tmp_path / "store", kept_results())
    folder = tmp_path / "sources" / "results"
    folder.parent.mkdir()
    with pytest.raises(UsageError, match="not the sources"):
        renew(runs, tmp_path / "store", folder)
    (folder.parent / "claims.toml").touch()
    counts = renew(runs, tmp_path / "store", folder)
    again = Results.load(folder)
    for run in runs:
        assert counts[run.name] == len(kept_results().seeds(run.name))
        assert again.tables[run.name].equals(kept_results().tables[run.name])
    assert verdicts_of(again) == from_json((folder / VERDICTS).read_text(encoding="utf-8"))


def test_preset_thesis_is_pinned() -> None:
    """Days of results rest on it; who changes it computes them again."""
    config = preset_config(World.of("arm4").kind, "thesis")
    assert repr(config.model) == MODEL
    assert repr(config.data) == DATA
    assert repr(config.trajectory) == TRAJECTORY
    assert repr(config.design) == DESIGN


MODEL = (
    "ModelConfig(rung='gp', choose_by='squared', process_from=1, kernel='ard_se', "
    "sharing='separate', process='thesis_dictionary_error', points=500, inducing=0, basis=100, "
    "fit_points=500, "
    "fit_spacing_s=0.0, candidates=('default',), steps=25, warm_from=1, warm_steps=0, "
    "method='minimize', starts=1, schedule='update', prior='none', "
    "noise_floor=0.0, floor_of='limit', stretch_s=8.0, calibrate=False, student_t=False, replace='chance')"
)
DATA = (
    "ArmData(inputs='desired', cutoff_hz='none', rate_hz=100.0, least_samples=0, "
    "stick_fraction=0.0, reversal=0.0, plenty=600, trim_s=0.0, friction_fraction=0.0, presliding=0.0, "
    "offset='spread')"
)
TRAJECTORY = "FourierConfig(harmonics=2, duration=60.0, omega0=(0.105, 0.2), rest='ramp', ramp=2.0)"
DESIGN = (
    "DesignConfig(criterion='mean_variance', sampler='scaled', candidates=24, refine=2, steps=15, "
    "points=50, planned_noise=False, reference_points=100, random_share=0.0, inducing=0, "
    "raw_units=True, first='random', reference='family')"
)
