"""A peer in this process and in one of its own: the same answers, and every way to fail."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from peer_examples import MakePeer, peer_maker

from etude_studies.peers.running import PeerUnavailable, here, in_own_process, started

HERE = Path(sys.executable)
RNG = np.random.default_rng(11)
X, Y = RNG.normal(size=(15, 3)), RNG.normal(size=15)
PARAMETERS = np.array([0.1, 0.2, -0.3, 1 / 3, -1.0])


@pytest.fixture
def make(tmp_path: Path) -> MakePeer:
    return peer_maker(tmp_path)


def test_the_same_bits_there_as_here(make: MakePeer) -> None:
    peer = make()
    with here(peer, X, Y) as own, in_own_process(HERE, peer, X, Y) as other:
        for parameters in (PARAMETERS, 0.5 * PARAMETERS, PARAMETERS):
            value, gradient, seconds = own.evaluate(parameters)
            value_there, gradient_there, seconds_there = other.evaluate(parameters)
            assert value_there == pytest.approx(value, rel=1e-13)
            np.testing.assert_allclose(gradient_there, gradient, rtol=1e-11)
            assert min(seconds, seconds_there) > 0.0
        assert other.described == f"{own.described}, own process"


def test_the_own_process_is_another_has_one_thread_and_ends(
    make: MakePeer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")  # of whoever starts it
    told = (
        "value, gradient = os.getpid(), np.array([float(os.environ[n]) for n in os.environ if 'NUM_TH' in n])"
    )
    with in_own_process(HERE, make(afterwards=told), X, Y) as running:
        number, threads, _ = running.evaluate(PARAMETERS)
        assert number != os.getpid()
        os.kill(int(number), 0)
        assert len(threads) >= 3
        assert set(threads) == {1.0}
    with pytest.raises(ProcessLookupError):
        os.kill(int(number), 0)


def test_the_own_process_sees_neither_etude_s_path_nor_the_adapters(
    make: MakePeer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    path = f"[place for place in sys.path if place == {str(tmp_path)!r} or place.endswith('peers')]"
    told = f"import sys; value = float(len({path}))"
    with in_own_process(HERE, make(afterwards=told), X, Y) as running:
        assert running.evaluate(PARAMETERS)[0] == 0.0


@pytest.mark.parametrize(
    ("afterwards", "said"),
    [
        ("raise ValueError('singular')", f"^{HERE}: ValueError: singular"),
        ("os.write(2, b'out of memory\\n'); os._exit(3)", "ended without an answer: out of memory"),
        ("os._exit(3)", "ended without an answer"),
    ],
)
def test_a_failure_in_the_own_process_is_told(make: MakePeer, afterwards: str, said: str) -> None:
    with in_own_process(HERE, make(afterwards=afterwards), X, Y) as running:
        for _ in range(2):
            with pytest.raises(PeerUnavailable, match=said):
                running.evaluate(PARAMETERS)


def test_a_failure_here_is_told(make: MakePeer) -> None:
    with (
        here(make(afterwards="raise ValueError('singular')"), X, Y) as running,
        pytest.raises(PeerUnavailable, match="here: ValueError: singular"),
    ):
        running.evaluate(PARAMETERS)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import no_such_library", "ModuleNotFoundError"),
        ("raise RuntimeError('made for another NumPy')", "made for another NumPy"),
        ("this is no Python", "SyntaxError"),
        ("NOTE = ''", "objective"),
    ],
)
def test_what_cannot_be_loaded_is_told_for_each_place(make: MakePeer, code: str, said: str) -> None:
    with (
        pytest.raises(PeerUnavailable) as raised,
        started(make("bad", code=code), X, Y, [HERE]),
    ):
        pass
    first, second = raised.value.fact.split("; ")
    assert first.startswith("here: ")
    assert second.startswith(f"{HERE}: ")
    assert said in first
    assert said in second


def test_an_interpreter_that_is_none_is_told(make: MakePeer, tmp_path: Path) -> None:
    for python, said in ((tmp_path / "none", "No such file"), (Path("/bin/true"), "without an answer")):
        with (
            pytest.raises(PeerUnavailable, match=said),
            in_own_process(python, make(), X, Y),
        ):
            pass


def test_here_comes_first(make: MakePeer) -> None:
    with started(make(afterwards="value = os.getpid()"), X, Y, [HERE]) as running:
        assert running.evaluate(PARAMETERS)[0] == os.getpid()
