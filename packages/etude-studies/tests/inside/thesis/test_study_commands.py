"""The study of the thesis from the command line: ids, options, second starts, somebody's own method."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from pathlib import Path

import pytest

from etude import plugins
from etude.cli import main
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import GROUPS, group_of, ledger, runs_of
from etude_studies.thesis.kept import kept_verdicts
from etude_studies.thesis.method import with_method
from etude_studies.thesis.pages import thesis_page

ROOT = Path(__file__).parents[5]
EXAMPLE = ROOT / "examples" / "method" / "my_kernel.py"
RUN = "mA6"
"""The cheapest run."""


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict, str]:
    """Exit code, data and messages of `etude study ... --json`."""
    code = main(["study", *words, "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def test_every_id_is_listed_in_the_machine_form(capsys) -> None:
    code, found, _ = answer(capsys, "list")
    ids = [row["metric"] for row in found["rows"]]
    assert code == 0
    assert len(set(ids)) == len(ids)
    assert {e.id for e in ledger().entries} | {c.id for c in ledger().claims} <= set(ids)
    assert {"arm", "quadrotor", "thesis"} <= set(ids)
    assert all(set(row) == {"metric", "what", "seeds", "verdict", "command"} for row in found["rows"])
    assert all(row["command"] == f"etude study run {row['metric']}" for row in found["rows"])


def test_a_study_that_cannot_be_loaded_harms_no_other(capsys, monkeypatch) -> None:
    broken = {**plugins.BUILT_IN["etude.studies"], "ours": "no_such_module:run"}
    monkeypatch.setitem(plugins.BUILT_IN, "etude.studies", broken)
    code, found, _ = answer(capsys, "list")
    ids = {row["metric"] for row in found["rows"]}
    assert code == 0
    assert {"table-6.9", "arm"} <= ids
    assert "ours" not in ids
    code, _, err = answer(capsys, "ours")
    assert code == 2
    assert "cannot be loaded" in err


def test_every_run_is_in_one_group_and_every_id_has_runs() -> None:
    groups = [name for name in GROUPS if name != "all"]
    parts = [set(runs_of(name)) for name in groups]
    assert set().union(*parts) == set(catalogue())
    assert sum(map(len, parts)) == len(catalogue())
    assert set(runs_of("all")) == set(catalogue()) - set(runs_of("miniature"))
    for entry in ledger().entries:
        assert runs_of(entry.id), entry.id


def test_what_claims_rest_on_is_in_the_catalogue_or_a_study_of_its_own() -> None:
    assert set(ledger().runs()) - set(catalogue()) <= {"O1", "L1"}


def test_the_runs_of_the_thesis_are_no_sensitivity_runs() -> None:
    assert {group_of(name) for name in ("A1", "S9", "Q4", "P2", "B0", "K1", "T1")} == {"thesis"}
    assert {group_of(name) for name in ("X1", "Q6u", "P5d", "X9")} == {"sensitivity"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "table-6.99"], "Did you mean table-6.9?"),
        (["show", "C6.2-33"], "Did you mean C6.2-3?"),
        (["run"], "Run what?"),
        (["run", RUN, "--seeds", "0"], "0 seeds are none"),
        (["arm", "--seeds", "0"], "The number of seeds must be 1 or more, not 0"),
        (["run", RUN, "--shard", "4/3"], "'4/3' is no shard"),
        (["run", RUN, "--workers", "0"], "0 workers do nothing"),
        (["run", RUN, "--method", "posture"], "'posture' is no module:attribute"),
        (["run", RUN, "--method", "no_such_module:posture"], "cannot be loaded"),
        (["run", RUN, "--method", "json:dumps"], "neither a kernel"),
        (["run", "B0", "--method", "etude.models.gp.kernels:ard_se"], "has a place for"),
        (["run", "CA-6"], "cannot be tested here"),
    ],
)
def test_wrong_words_are_said_with_what_to_do(capsys, tmp_path: Path, words: list[str], said: str) -> None:
    code, found, err = answer(capsys, *words, *(["--folder", str(tmp_path)] if words[0] != "show" else []))
    assert code == 2
    assert said in err
    assert found["error"]["exit_code"] == 2
    assert not list(tmp_path.rglob("*.parquet"))


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder in which the first seed has run, and what the command said."""
    folder, said = tmp_path_factory.mktemp("begun"), io.StringIO()
    with contextlib.redirect_stdout(said):
        main(["study", "run", RUN, "--seeds", "2", "--folder", str(folder), "--shard", "1/2", "--json"])
    return folder, said.getvalue()


@pytest.fixture
def folder(begun: tuple[Path, str], tmp_path: Path) -> Path:
    return Path(shutil.copytree(begun[0], tmp_path / "folder"))


def test_a_second_start_repeats_nothing_and_a_shard_does_its_part(capsys, begun, folder: Path) -> None:
    words, first = ["run", RUN, "--seeds", "2", "--folder", str(folder)], json.loads(begun[1])
    _, second, _ = answer(capsys, *words)
    _, third, _ = answer(capsys, *words)
    assert (first["ran"], second["ran"], third["ran"]) == (2, 2, 0)  # each with the motions of its seed
    assert third["kept"] == 2
    assert not third["failed"]


def test_the_example_of_the_page_gets_a_row_without_an_edit(capsys, folder: Path, monkeypatch) -> None:
    page = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
    assert EXAMPLE.read_text(encoding="utf-8").rstrip() in page
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 30
    monkeypatch.syspath_prepend(str(EXAMPLE.parent))
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE.parent))  # of the processes that compute
    words = ["run", RUN, "--seeds", "1", "--folder", str(folder), "--method", "my_kernel:two_parts"]
    code, found, _ = answer(capsys, *words)
    assert code == 0
    assert not found["failed"]
    assert (folder / "thesis" / "collected" / f"{RUN}+my_kernel.two_parts.parquet").exists()


def test_another_version_of_a_method_is_another_run(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    source = "from etude.models.gp.kernels import ard_se\n"
    (tmp_path / "kernel_v1.py").write_text(source, encoding="utf-8")
    first = with_method(catalogue()[RUN], "kernel_v1:ard_se")
    (tmp_path / "kernel_v1.py").write_text(source + "# changed\n", encoding="utf-8")
    second = with_method(catalogue()[RUN], "kernel_v1:ard_se")
    assert first is not None
    assert second is not None
    assert first.spec(0) != second.spec(0)
    assert first.spec(0) != catalogue()[RUN].spec(0)


BROKEN = """
import time
import numpy as np
from etude.models.gp.kernels import SquaredExponential

class Nan(SquaredExponential):
    def gram(self, theta, X):
        K, pull = super().gram(theta, X)
        return np.full_like(K, np.nan), pull

def nan(columns, commands):
    return Nan(tuple(range(len(columns))))

def endless(columns, commands):
    time.sleep(600.0)
"""


@pytest.mark.parametrize("name", ["nan", "endless"])
def test_a_bad_method_concerns_its_own_rows(
    capsys, folder: Path, tmp_path: Path, monkeypatch, name: str
) -> None:
    (tmp_path / "broken_kernel.py").write_text(BROKEN, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    limit, said = {"nan": ("60", "returns values that are not numbers"), "endless": ("1", "after 1 s")}[name]
    words = ["run", RUN, "--seeds", "1", "--folder", str(folder), "--limit-s", limit]
    _, found, err = answer(capsys, *words, "--method", f"broken_kernel:{name}")
    assert (found["ran"], found["kept"]) == (0, 1), err
    (reason,) = found["failed"].values()
    assert said in reason
    assert (folder / "thesis" / "collected" / f"{RUN}.parquet").exists()  # the run without the method


@pytest.mark.slow
def test_the_seeds_that_a_page_asks_for_decide_its_claim(capsys, tmp_path: Path, monkeypatch) -> None:
    """More seeds than asked for, of which as many count; the committed pages stay as they are."""
    monkeypatch.chdir(tmp_path)
    asks = kept_verdicts()["C2.4-1"].asks
    assert asks
    code, _, _ = answer(capsys, "run", "K1", "--seeds", str(asks + 9), "--workers", "1", "--go-on")
    assert code == 0
    answer(capsys, "report", "--folder", "results", "--output", "site")
    page = (tmp_path / "site" / "C2.4-1.html").read_text(encoding="utf-8")
    lead = page[page.index('class="lead verdict"') :].partition("</p>")[0]
    assert "not decided" not in lead
    assert f"of {asks} seeds" in lead


def test_the_page_of_the_thesis_is_of_the_committed_results() -> None:
    page = (ROOT / "docs" / "thesis.md").read_text(encoding="utf-8")
    assert page == thesis_page(), "run: etude study report --update"
