"""Plug-ins by name: the table, entry points of other distributions, and how each way of failing reads."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from etude import plugins
from etude.campaign import find_robot
from etude.errors import DataError, UsageError

VESSEL = """
class KIND:
    name, path = "a vessel", "p"
    tables, presets = {"trajectory": dict, "data": dict}, {"default": {}, "thesis": {}}
    recognises = described = spec = lambda path: None
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """A function that installs a distribution with one module and entry points."""
    monkeypatch.syspath_prepend(str(tmp_path))
    plugins._installed.cache_clear()
    monkeypatch.setattr(plugins, "_failures", {})

    def install(name: str, points: str, module: str = "") -> None:
        info = tmp_path / f"{name}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
        (info / "entry_points.txt").write_text(points)
        (tmp_path / f"{name}_module.py").write_text(module)
        plugins._installed.cache_clear()

    yield install
    plugins._installed.cache_clear()
    for name in [n for n in sys.modules if n.endswith("_module")]:
        del sys.modules[name]


def test_every_row_of_the_table_names_a_module_and_an_attribute() -> None:
    for rows in plugins.BUILT_IN.values():
        assert all(plugins.FULL_NAME.fullmatch(target) for target in rows.values())


@pytest.mark.parametrize("group", plugins.BUILT_IN)
def test_every_row_of_the_table_is_there(group: str) -> None:
    for name in plugins.BUILT_IN[group]:
        assert plugins.load(group, name) is not None


def test_a_plug_in_follows_the_built_ins_and_is_imported_only_when_named(installed) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "[etude.robots]\nvessel = rov_module:KIND\n", VESSEL)
    assert plugins.names("etude.robots") == ("arm", "quadrotor", "vessel")
    assert "rov_module" not in sys.modules
    assert plugins.load("etude.robots", "vessel").name == "a vessel"
    row = next(p for p in plugins.listed() if p.name == "vessel")
    assert (row.source, row.target, row.problem) == ("rov 1.2", "rov_module:KIND", "")


def test_two_of_one_name_are_refused_with_both_distributions(installed) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "[etude.kernels]\nmatern = rov_module:KIND\nard_se = rov_module:KIND\n")
    installed("kelp", "[etude.kernels]\nmatern = kelp_module:KIND\n")
    with pytest.raises(UsageError, match=r"kelp 1\.2 and rov 1\.2"):
        plugins.load("etude.kernels", "matern")
    with pytest.raises(UsageError, match=r"of etude and rov 1\.2"):
        plugins.load("etude.kernels", "ard_se")
    assert {p.source for p in plugins.listed() if "used twice" in p.problem} == {
        "etude",
        "rov 1.2",
        "kelp 1.2",
    }


def test_two_packages_of_one_kind_are_named_and_harm_no_other(installed, tmp_path) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "[etude.robots]\nvessel = rov_module:KIND\n", VESSEL)
    installed("kelp", "[etude.robots]\nvessel = kelp_module:KIND\n", VESSEL)
    assert find_robot("arm4")[0].name == "arm"
    (tmp_path / "mine.toml").write_text('kind = "vessel"\nname = "mine"\n')
    with pytest.raises(UsageError, match="no known kind of robot") as refused:
        find_robot(str(tmp_path / "mine.toml"))
    assert (
        "two plug-ins are named 'vessel' (kind of robot): of kelp 1.2 and rov 1.2" in refused.value.next_step
    )


HALF = """
class Exporter:
    def __call__(self, trajectory, kind, spec): ...
    def back(self, files): ...
    def strays(self, files): ...
EXPORTER = Exporter()
"""


def test_half_an_ability_is_named_with_the_protocol_to_declare(installed) -> None:  # type: ignore[no-untyped-def]
    installed("old", "[etude.exporters]\nold = old_module:EXPORTER\n", HALF)
    with pytest.raises(UsageError, match="Exporter has strays and lacks accelerations") as refused:
        plugins.load("etude.exporters", "old")
    assert "etude.abilities.SupportsCommandedFiles" in refused.value.next_step
    assert "strays" in next(p.problem for p in plugins.listed(tried=True) if p.name == "old")


def test_a_row_of_the_table_repeated_as_an_entry_point_is_one_plug_in(installed) -> None:  # type: ignore[no-untyped-def]
    installed("copy", "[etude.criteria]\nivr = etude.design.criteria:ivr\n")
    assert [p.name for p in plugins.listed() if p.name == "ivr"] == ["ivr"]


def test_one_that_cannot_be_imported_is_named_with_its_reason(installed) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "[etude.robots]\nvessel = rov_module:KIND\n", "import nowhere_to_be_found")
    assert not any(p.problem for p in plugins.listed())
    with pytest.raises(UsageError, match="nowhere_to_be_found") as caught:
        plugins.load("etude.robots", "vessel")
    assert "rov 1.2" in caught.value.where
    assert ["nowhere_to_be_found" in p.problem for p in plugins.listed() if p.name == "vessel"] == [True]


def test_listing_tries_the_plug_ins_of_others_on_request(installed) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "[etude.robots]\nvessel = rov_module:MISSING\n")
    assert [p.problem for p in plugins.listed(tried=True) if p.name == "vessel"] != [""]


def test_full_names_need_no_table(installed) -> None:  # type: ignore[no-untyped-def]
    installed("rov", "", "class Box:\n    lid = 7\n")
    assert plugins.named_in_full("rov_module:Box.lid") == 7
    with pytest.raises(UsageError, match=r"Box\.lid is not a kernel's factory"):
        plugins.load("etude.kernels", "rov_module:Box.lid")


def test_a_module_that_is_not_found_is_told_apart_from_what_it_lacks(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """A file beside the campaign is found by PYTHONPATH; one that lacks an import is found, and fails."""
    with pytest.raises(UsageError, match="PYTHONPATH=FOLDER") as problem:
        plugins.load("etude.kernels", "kernels_of_mine:posture")
    assert "kernels_of_mine.py" in problem.value.next_step
    (tmp_path / "kernels_of_mine.py").write_text("import what_nobody_has\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UsageError, match="what_nobody_has") as problem:
        plugins.load("etude.kernels", "kernels_of_mine:posture")
    assert "PYTHONPATH" not in problem.value.next_step


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="Did you mean quadrotor"):
        plugins.load("etude.robots", "quadroter")


def test_a_misspelt_attribute_is_answered_with_the_nearest(installed) -> None:  # type: ignore[no-untyped-def]
    installed("own", "[etude.limits]\nown = own_module:flange_hight\n", "def flange_height(a, b, c): ...\n")
    with pytest.raises(UsageError, match="the limit 'own' cannot be loaded") as problem:
        plugins.load("etude.limits", "own")
    assert problem.value.next_step.startswith("Did you mean flange_height? ")


READER = """
class ReadBarlog:
    def recognises(self, path, head):
        return path.suffix == ".barlog"

    def __call__(self, path, topics=()):
        return {}
"""


def test_a_reader_that_is_named_by_its_class(installed, tmp_path) -> None:  # type: ignore[no-untyped-def]
    installed("bar", "[etude.readers]\nbarlog = bar_module:ReadBarlog\n", READER)
    said = r"barlog is a class; name an instance: barlog = ReadBarlog\(\)"
    with pytest.raises(UsageError, match=said):
        plugins.load("etude.readers", "barlog")
    (row,) = [p for p in plugins.listed(tried=True) if p.name == "barlog"]
    assert row.problem == "barlog is a class; name an instance: barlog = ReadBarlog()"
    path = tmp_path / "run.barlog"
    path.write_text("1 2 3")
    start = r"there is no reader for '\.barlog' files; the reader barlog cannot be loaded: "
    with pytest.raises(DataError, match=start + said) as caught:
        importlib.import_module("etude.logs.readers.registry").read_raw(path)
    assert "ulog" in caught.value.next_step
    assert "barlog" not in caught.value.next_step


def test_a_factory_may_be_a_class(installed) -> None:  # type: ignore[no-untyped-def]
    code = "class Made:\n    def __init__(self, columns, commands): ...\n"
    installed("made", "[etude.kernels]\nmade = made_module:Made\n", code)
    assert plugins.load("etude.kernels", "made").__name__ == "Made"
