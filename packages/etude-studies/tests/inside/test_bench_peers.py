"""The rows beside other libraries, with peers made for the purpose: no other library is needed."""

from __future__ import annotations

import json
import sys
import tomllib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from peer_examples import SPECTRAL, MakePeer, peer_maker
from threadpoolctl import threadpool_info, threadpool_limits

from etude.cli import main
from etude_studies import bench_gp, bench_peers
from etude_studies.bench_peers import in_turn, peer_rows, spectrum_rows
from etude_studies.peers.catalogue import EXACT, SPECTRUM
from etude_studies.peers.running import Running

HERE = Path(sys.executable)
ABSENT = "import no_such_library_anywhere"


@pytest.fixture
def make(tmp_path: Path) -> MakePeer:
    return peer_maker(tmp_path)


@pytest.fixture
def problems() -> dict:
    rng = np.random.default_rng(3)
    return {n: bench_gp.random_process(n, rng) for n in (8, 12)}


def test_a_peer_here_gives_agreement_and_time_at_each_size(make: MakePeer, problems: dict, capsys) -> None:
    rows = peer_rows(problems, [make()])
    assert [row.metric for row in rows] == [
        "nlml_agreement_n8_dense",
        "nlml_gradient_n8_dense",
        "nlml_agreement_n12_dense",
        "nlml_gradient_n12_dense",
    ]
    for agreement, time in (rows[:2], rows[2:]):
        assert 0.0 < agreement.value < 1e-12
        assert agreement.reference_value == bench_peers.TOLERANCE
        assert time.unit == "ms"
        assert time.value > 0.0
        assert time.reference_value is not None
        assert time.reference_value > 0.0
        assert time.reference == f"Étude, in turn; Dense {np.__version__}, made for a test"
    assert capsys.readouterr().err == ""


def test_the_value_is_the_peer_s_and_the_reference_ours(problems: dict, monkeypatch, make: MakePeer) -> None:
    gp, X, y = problems[8]

    def answer(parameters: np.ndarray) -> tuple[float, np.ndarray, float]:
        value, gradient = gp.with_parameters(parameters).log_marginal_likelihood(X, y)
        return -value, -gradient, 700.0

    monkeypatch.setattr(bench_peers, "started", lambda *_: nullcontext(Running("Slow 1.0", answer)))
    _, time = peer_rows({8: problems[8]}, [make()])
    assert time.value == 700e3
    assert time.reference_value is not None
    assert time.reference_value < 60e3


def test_what_cannot_be_imported_here_runs_in_its_own_process(make: MakePeer, problems: dict, capsys) -> None:
    # its library is in the other interpreter alone: it does not know this process
    elsewhere = f"if 'pytest' in sys.modules: {ABSENT}"
    code = f"import sys\n{elsewhere}\n" + Path(make().file).read_text(encoding="utf-8")
    rows = peer_rows(problems, [make("far", code=code)], [HERE])
    assert [row.metric for row in rows][1::2] == ["nlml_gradient_n8_far", "nlml_gradient_n12_far"]
    assert all(row.reference.endswith("made for a test, own process") for row in rows)
    assert all(row.value < 1e-12 for row in rows[::2])
    out, err = capsys.readouterr()
    assert out == err == ""


@pytest.mark.parametrize(
    "spoilt",
    [
        "value += 1e-3",
        "gradient[2] *= 1.01",
        "gradient[-1] = np.nan",
        "value = np.nan",
        "gradient = gradient[:-1]",
        "gradient = 1.0",
    ],
)
@pytest.mark.parametrize("pythons", [(), (HERE,)], ids=["here", "there"])
def test_a_peer_that_disagrees_is_named_and_not_timed(
    make: MakePeer, problems: dict, capsys, spoilt: str, pythons: tuple[Path, ...]
) -> None:
    code = f"import sys\nif 'pytest' in sys.modules: {ABSENT}\n" if pythons else ""
    code += make().file.read_text(encoding="utf-8").replace("pass", spoilt)
    one = {8: problems[8]}
    (row,) = peer_rows(one, [make("wrong", code=code)], pythons)
    assert row.metric == "nlml_agreement_n8_wrong"
    assert not row.value <= bench_peers.TOLERANCE
    said = capsys.readouterr().err
    assert "Wrong" in said
    assert "disagrees" in said
    assert "is not timed" in said


def test_a_missing_peer_gives_no_row_and_says_how_to_install_it(
    make: MakePeer, problems: dict, capsys
) -> None:
    nowhere = HERE.with_name("no-such-python")
    rows = peer_rows(problems, [make("gone", code=ABSENT), make()], [nowhere])
    assert {row.metric.rsplit("_", 1)[1] for row in rows} == {"dense"}, "the others are measured all the same"
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("Gone is left out from n = 8 on (here: ModuleNotFoundError: No module named")
    assert f"{nowhere}: No such file" in line
    assert "pip install './packages/etude-studies[bench]'" in line


def test_a_peer_that_fails_at_a_size_keeps_the_rows_before_it(make: MakePeer, problems: dict, capsys) -> None:
    too_large = "if len(y) > 8: raise MemoryError('no room')"
    rows = peer_rows(problems, [make(afterwards=too_large)])
    assert [row.metric for row in rows] == ["nlml_agreement_n8_dense", "nlml_gradient_n8_dense"]
    assert "left out from n = 12 on (here: MemoryError: no room)" in capsys.readouterr().err


def test_both_evaluate_in_turn_at_parameters_that_change() -> None:
    seen: list[tuple[str, float]] = []

    def evaluate(name: str, seconds: list[float]):
        def run(parameters: np.ndarray) -> tuple[float, np.ndarray, float]:
            seen.append((name, float(parameters[0])))
            assert all(pool["num_threads"] == 1 for pool in threadpool_info() if pool["user_api"] == "blas")
            return 0.0, parameters, seconds.pop()

        return run

    first, second = evaluate("a", [9.0, 1.0, 2.0]), evaluate("b", [0.5, 0.1, 0.3])
    with threadpool_limits(2):
        assert in_turn([first, second], np.zeros(2), 3) == pytest.approx([2000.0, 300.0])
    assert [name for name, _ in seen] == ["a", "b"] * 3
    assert seen[0][1] == seen[1][1]
    assert len({place for _, place in seen}) == 3


@pytest.fixture
def small_spectrum(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"SPECTRAL_POINTS": 5, "SPECTRAL_SAMPLES": 30, "SPECTRAL_REPEATS": 1}.items():
        monkeypatch.setattr(bench_peers, name, value)


@pytest.mark.usefixtures("small_spectrum")
def test_the_spectrum_stands_beside_its_peer(make: MakePeer) -> None:
    agreement, time = spectrum_rows(3, np.random.default_rng(0), make("same", code=SPECTRAL))
    assert agreement.metric == "ssgp_agreement_m5_n30"
    assert agreement.value == 0.0
    assert time.metric == "ssgp_nlml_gradient_m5_n30"
    assert time.reference == f"in turn, Same {np.__version__}"
    assert time.ratio is not None


@pytest.mark.usefixtures("small_spectrum")
@pytest.mark.parametrize(
    ("code", "said", "metrics"),
    [
        (ABSENT, "the sparse spectrum has no Torch beside it", ["ssgp_nlml_gradient_m5_n30"]),
        (
            SPECTRAL.replace("-value", "value"),
            "disagrees",
            ["ssgp_agreement_m5_n30", "ssgp_nlml_gradient_m5_n30"],
        ),
    ],
)
def test_the_spectrum_alone_has_no_reference(
    make: MakePeer, capsys, code: str, said: str, metrics: list[str]
) -> None:
    rows = spectrum_rows(3, np.random.default_rng(0), make("torch", code=code))
    assert [row.metric for row in rows] == metrics
    assert rows[-1].value > 0.0
    assert rows[-1].reference_value is None
    assert said in capsys.readouterr().err


@pytest.fixture
def small_bench(monkeypatch: pytest.MonkeyPatch, make: MakePeer, small_spectrum: None) -> None:
    for name, value in {"LIKELIHOOD_REPEATS": {}, "POINTS": 20, "GRADIENT_REPEATS": 1}.items():
        monkeypatch.setattr(bench_gp, name, value)
    monkeypatch.setattr(bench_peers, "REPEATS", {8: 1, 1200: 1})
    monkeypatch.setattr(bench_gp, "EXACT", (make(),))
    monkeypatch.setattr(bench_gp, "SPECTRUM", make("same", code=SPECTRAL))
    ours = bench_gp.random_process
    monkeypatch.setattr(bench_gp, "random_process", lambda n, rng: ours(min(n, 20), rng))


@pytest.mark.usefixtures("small_bench")
@pytest.mark.parametrize("quick", [True, False])
def test_the_bench_ends_with_the_rows_of_the_peers(capsys, quick: bool) -> None:
    options = ["--python", "an env/python", "--json", *(["--quick"] if quick else [])]
    assert main(["bench", "gp", *options]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    names = [row["metric"] for row in found["rows"]]
    peers = ["nlml_agreement_n8_dense", "nlml_gradient_n8_dense"]
    larger = [] if quick else ["nlml_agreement_n1200_dense", "nlml_gradient_n1200_dense"]
    assert names[2:] == [*peers, *larger, "ssgp_agreement_m5_n30", "ssgp_nlml_gradient_m5_n30"]
    flag = "--quick " if quick else ""
    assert found["command"] == f"etude bench gp --python 'an env/python' {flag}--json"


def test_other_interpreters_come_from_the_command_line(monkeypatch) -> None:
    seen = []

    def run(*, json: bool, seed: int, pythons: tuple[Path, ...] = ()) -> None:
        seen.append(tuple(pythons))

    monkeypatch.setattr(bench_gp, "run", run)
    assert main(["bench", "gp", "--python", "a/python", "--python", "b/python"]) == 0
    assert main(["bench", "gp"]) == 0
    assert seen == [(Path("a/python"), Path("b/python")), ()]


def test_a_bench_without_peers_refuses_interpreters(capsys) -> None:
    assert main(["bench", "models", "--python", str(HERE)]) == 2
    assert "does not take --python" in capsys.readouterr().err


def test_the_sizes_and_the_extra() -> None:
    assert list(bench_peers.REPEATS) == [500, 1000, 3000]
    assert (bench_peers.SPECTRAL_POINTS, bench_peers.SPECTRAL_SAMPLES) == (200, 3000)
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    extra = {entry.split(">")[0] for entry in project["project"]["optional-dependencies"]["bench"]}
    assert extra == {peer.distribution for peer in (*EXACT, SPECTRUM)}
