"""Who waits for the compiler is told so, once."""

from __future__ import annotations

from types import SimpleNamespace

from etude import plugins
from etude.models import SupportsFirstUse
from etude_lagrangian import all_lin, all_outputs, gip_lin
from etude_lagrangian.kernel import SENTENCE


class Sweep:
    """A function as numba leaves it."""

    def __init__(self, folder, signatures=()) -> None:
        self.signatures, self.py_func = signatures, all_outputs.sweep_all.py_func
        self.stats = SimpleNamespace(cache_path=str(folder))


def test_only_what_is_compiled_and_not_yet_there_is_announced(monkeypatch, tmp_path) -> None:
    for name in ("structured", "ard_se"):
        assert not isinstance(plugins.load("etude.kernels", name), SupportsFirstUse)
    done = Sweep(tmp_path, signatures=("a",))
    for name in ("sweep_all", "means_all"):
        monkeypatch.setattr(all_outputs, name, done)
    monkeypatch.setattr("etude_lagrangian.one_output.sweep", done)
    assert gip_lin.first_use() == ""
    monkeypatch.setattr(all_outputs, "sweep_all", Sweep(tmp_path))
    assert gip_lin.first_use() == SENTENCE
    assert all_lin.first_use() == SENTENCE
    line = all_outputs.sweep_all.py_func.__code__.co_firstlineno
    (tmp_path / f"all_outputs.sweep_all-{line}.py3.nbi").touch()  # an earlier process was here
    assert gip_lin.first_use() == ""
