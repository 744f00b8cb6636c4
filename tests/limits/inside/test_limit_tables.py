"""Limits of one's own in robot.toml: the plane of the docs goes the whole way, for an arm and a vehicle."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import etude
from certificate_schema import valid
from etude import cli
from etude._runtime.trusted_folders import trust_file
from etude.abilities import SupportsBlocking, SupportsBoxes, SupportsDrawing
from etude.errors import UsageError
from etude.limits import AxisLimit, LipschitzLimit, certify, made_limits, utilization
from etude.limits.lipschitz import extremes
from etude.plugins import _typed_names
from etude.protocols import Limit, Trajectory
from etude.testing import LimitSuite
from etude.trajectories import FourierConfig, FourierFamily, PointToPoint
from etude.types import Proof
from etude_arm import KIND as ARM
from etude_quadrotor import KIND as QUADROTOR

PAGE = Path(__file__).parents[3] / "docs" / "plugin_examples.md"
WALL = """

def wall(spec, model, margins, *, normal: tuple[float, float, float], distance: float):
    unit = np.array(normal)
    shown = (Thing.plane("wall", distance * unit, -unit),)
    ends = -10.0, distance
    return LipschitzLimit("wall", "vehicle", lambda p: p @ unit, np.abs(unit), *ends, margins, shown)


def bare(spec, model, margins, height: float):
    return object()


def broken(spec, model, margins):
    return object()


class Fails:
    name = "mine"

    def cones(self, family):
        return ()

    def penalty(self, motion):
        return None

    def of_motion(self, motion):
        return np.zeros((len(motion), 0))

    def prove(self, piece):
        return np.zeros(3) @ np.zeros(99)


def fails(spec, model, margins):
    return Fails()


class AsksTooMuch(Fails):
    def prove(self, piece):
        from etude.trajectories import PointToPoint

        PointToPoint(np.zeros((2, 4)) + [[0.0], [1.0]], 1.0).motion(np.zeros(1), 5)


def asks_too_much(spec, model, margins):
    return AsksTooMuch()


class Silent(Fails):
    def prove(self, piece):
        return []


def silent(spec, model, margins):
    return Silent()


class Rest(Fails):
    name = "speed sum"

    def of_motion(self, motion):
        return np.abs(motion.orders[1]).sum(axis=1)[:, None]

    def prove(self, piece):
        from etude.types import Proof

        most = self.of_motion(piece.motion(np.linspace(0.0, piece.duration, 500), 2)).max()
        return [Proof("all", "speed sum", -np.inf, 0.0, 0.0, most, "samples", "sampled", 0.4, 0.0)]


def rest(spec, model, margins):
    return Rest()


def exchanged(spec, margins, model):
    return LipschitzLimit("sum", "all", lambda p: p.sum(axis=1), np.ones(4), -9.0, 9.0, margins)


def ends(spec, model, margins):
    raise SystemExit("set FOO first")


def of_joint(spec, model, margins, *, joint: str):
    column = spec.names.index(joint)
    return LipschitzLimit("turn", joint, lambda q: q[:, column], np.ones(4), -9.0, 9.0, margins)
"""


def block(language: str, word: str) -> str:
    """The block of the page that holds a word."""
    fence = re.compile(rf"^```{language}\n(.*?)^```", re.DOTALL | re.MULTILINE)
    found = fence.findall(PAGE.read_text(encoding="utf-8"))
    return next(code for code in found if word in code)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the module that the page writes, an arm and a vehicle with its limits."""
    (tmp_path / "my_limits.py").write_text(block("python", "def plane") + WALL, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    _typed_names.difference_update({"my_limits:plane", "my_limits:wall"})
    own = ARM.built_in()["arm4"]
    text = own.read_text().replace("arm4_linkage.xml", str(own.parent / "arm4_linkage.xml"))
    (tmp_path / "arm.toml").write_text(text + block("toml", "[[limit]]"))
    table = '[[limit]]\nkind = "my_limits:wall"\nnormal = [1.0, 0.0, 0.0]\ndistance = 2.5\n'
    (tmp_path / "quad.toml").write_text(QUADROTOR.built_in()["quadrotor"].read_text() + table)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def certificate(folder: str) -> list[dict[str, object]]:
    rows = valid(Path(folder, "proposals/0001/certificate.json").read_text())["rows"]
    return [row for row in rows if row["quantity"] in ("height", "wall")]


def test_an_error_in_a_limit_of_ones_own_is_told_as_such(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:fails"\n')
    assert cli.main(["init", "lab", "--robot", str(path), "--trust"]) == 0
    capsys.readouterr()
    assert cli.main(["ask", "lab", "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["kind"] == "PluginError"
    assert "the plug-in my_limits:fails raised ValueError" in error["fact"]
    line = next(
        n for n, text in enumerate(Path("my_limits.py").read_text().splitlines(), 1) if "zeros(99)" in text
    )
    assert f"my_limits.py:{line}" in error["where"]


def test_an_error_of_what_a_limit_calls_names_the_limit(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:asks_too_much"\n')
    assert cli.main(["init", "lab", "--robot", str(path), "--trust"]) == 0
    capsys.readouterr()
    assert cli.main(["ask", "lab", "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert "has the orders 1 to 4, not 5" in error["fact"]
    assert "in the plug-in my_limits:asks_too_much" in error["where"]
    assert "Ask for 4 at most" in error["next_step"]


def test_a_joint_that_is_none_is_refused_before_anything_is_made_or_trusted(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place / "arm.toml"
    text = path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:of_joint"\njoint = "elbw"\n'
    path.write_text(text)
    assert cli.main(["init", "lab", "--robot", "arm.toml", "--trust", "--json"]) == 2
    told = capsys.readouterr()
    error = json.loads(told.out)["error"]
    names = etude.load_robot(place / "arm.toml", trust=True).names
    assert "ValueError" in error["fact"]
    assert ", ".join(names) in error["next_step"]
    assert not Path("lab").exists()
    assert not trust_file().exists()
    assert "trusted from now on" not in told.err
    path.write_text(text.replace("elbw", names[-1]))
    assert cli.main(["init", "lab", "--robot", "arm.toml", "--trust"]) == 0
    assert "trusted from now on" in capsys.readouterr().err
    assert str(path) in trust_file().read_text()


def test_a_limit_that_ends_the_program_is_told_as_such(place, capsys: pytest.CaptureFixture[str]) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:ends"\n')
    assert cli.main(["init", "lab", "--robot", str(path), "--trust", "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert "the plug-in my_limits:ends raised SystemExit: set FOO first" in error["fact"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "silent",
            "the prove of the limit my_limits:silent returned .*nothing: at least one",
        ),
        ("exchanged", "the tracking margins of the limit of sum are NoneType"),
    ],
)
def test_what_a_limit_owes_is_named(place: Path, name: str, said: str) -> None:
    """A limit without a row, or without tracking margins, would leave a certificate that looks complete."""
    path = place / "arm.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + f'[[limit]]\nkind = "my_limits:{name}"\n')
    spec = etude.load_robot(path, trust=True)
    with pytest.raises(UsageError, match=said):
        made_limits(spec.limits, spec, None, {})[0].prove(a_motion())


@pytest.mark.slow
def test_the_plane_of_the_docs_goes_the_whole_way(place, capsys) -> None:
    assert cli.main(["init", "lab", "--robot", "arm.toml"]) == 2
    said = capsys.readouterr().err
    assert "my_limits:plane" in said
    assert "--robot arm.toml --trust" in said
    assert cli.main(["init", "lab", "--robot", "arm.toml", "--trust"]) == 0
    assert block("toml", "[[limit]]").strip() in Path("lab/robot.toml").read_text()
    assert cli.main(["ask", "lab", "--from", "home", "--format", "ros2_csv"]) == 0
    said = capsys.readouterr().out
    assert re.search("height of +proved at least", said)
    assert "distance (m)" not in said  # nobody stated the unit of an own function
    (row,) = certificate("lab")
    assert (row["axis"], row["status"]) == ("tool", "proved")
    assert row["proved_lower"] >= row["lower"] == pytest.approx(0.3 + row["tracking_margin"])
    rows = valid(Path("lab/proposals/0001/certificate.json").read_text())["swept"]
    swept = {one["axis"]: one["of_range"] for one in rows}
    assert min(swept[name] for name in ("waist", "elbow", "wrist")) > 0.5, "a limit of the shoulder alone"
    played = valid(Path("lab/proposals/0001/from_home/ros2_csv/certificate.json").read_text())["rows"]
    rows = [row for row in played if row["quantity"].startswith("height")]
    assert {"height", "height, held before the first row"} <= {row["quantity"] for row in rows}
    assert all(row["proved_lower"] >= row["lower"] for row in rows)
    limit = etude.open_campaign(Path("lab")).limits()[-1]
    assert isinstance(limit, LipschitzLimit)
    for wanted in (Limit, SupportsBlocking, SupportsBoxes, SupportsDrawing):
        assert isinstance(limit, wanted)
    assert cli.main(["report", "lab"]) == 0
    page = Path("lab/report.html").read_text()
    assert ">plane</text>" in page
    assert "proved height" in page


def test_a_limit_of_ones_own_without_a_tracking_margin_is_named(place) -> None:
    """In the certificate: a limit that ignores its argument `margins` is met by the plan alone."""
    spec = etude.load_robot(str(place / "arm.toml"), trust=True)
    margins = {form: (np.full((2, spec.dof), 0.01), np.ones((2, spec.dof))) for form in ("fourier", "moves")}
    (own,) = made_limits(spec.limits, spec, None, margins)
    (careless,) = made_limits(spec.limits, spec, None, {})
    motion = PointToPoint(np.zeros((2, spec.dof)), 1.0)
    range_ = AxisLimit("position", 0, spec.names, spec.lower, spec.upper, margins=margins)
    named = "The tracking error of height."
    assert named not in certify(motion, [range_, own]).not_verified
    assert named in certify(motion, [range_, careless]).not_verified


def test_a_limit_that_no_motion_keeps_refuses_every_proposal(place, capsys) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().replace("height = 0.3", "height = 1.9"))
    assert cli.main(["init", "lab", "--robot", "arm.toml", "--trust"]) == 0
    assert cli.main(["ask", "lab"]) != 0
    said = " ".join(capsys.readouterr().err.split())
    found = re.search(r"limits: height of tool is (\S+), limit (\S+) with a tracking margin of (\S+),", said)
    assert found
    value, limit, margin = map(float, found.groups())
    assert value < 1.9 == pytest.approx(limit - margin, abs=1e-3)
    assert "torque" not in said
    assert "`home` of [search] in robot.toml" in said
    assert not list(Path("lab/proposals").glob("0*"))


def test_a_limit_whose_margin_leaves_rest_alone_refuses_every_proposal(place, capsys) -> None:
    path = place / "arm.toml"
    path.write_text(
        path.read_text().replace(block("toml", "[[limit]]"), '[[limit]]\nkind = "my_limits:rest"\n')
    )
    assert cli.main(["init", "lab", "--robot", "arm.toml", "--trust"]) == 0
    capsys.readouterr()
    assert cli.main(["ask", "lab"]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "Only rest keeps all limits" in said
    assert "speed sum of all" in said
    assert not list(Path("lab/proposals").glob("0*"))


def test_a_wall_bounds_a_vehicles_flights_their_exports_and_the_drawing(place) -> None:
    assert cli.main(["init", "quad", "--robot", "quad.toml", "--trust"]) == 0
    assert cli.main(["ask", "quad", "--from", "home", "--format", "px4"]) == 0
    rows = certificate("quad")
    assert rows
    assert all(row["upper"] <= 2.5 and row["proved_upper"] <= row["upper"] for row in rows)
    played = [valid(p.read_text()) for p in Path("quad/proposals/0001").rglob("*certificate.json")]
    assert len(played) == 5
    assert all(any(row["quantity"].startswith("wall") for row in one["rows"]) for one in played)
    assert cli.main(["report", "quad"]) == 0
    assert ">wall</text>" in Path("quad/report.html").read_text()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("heigth = 0.3", "unknown key 'heigth'"),
        ('height = "low"', 'height takes a number, not "low"'),
        ("normal = [0.0, 1.0]", "normal takes a list of 3 entries, each a number, not [0.0, 1.0]"),
        ("", "missing height"),
    ],
)
def test_a_table_is_read_strictly(place, line: str, said: str) -> None:
    path, key = place / "arm.toml", line.split(" ")[0].replace("heigth", "height") or "height"
    path.write_text(re.sub(rf"(?m)^{key} = .*$", line, path.read_text()))
    with pytest.raises(UsageError, match=re.escape(said)) as caught:
        etude.load_robot(path, trust=True)
    assert "limit 1" in caught.value.where


def test_keys_without_a_star_are_named_with_the_signature(place) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:bare"\n')
    with pytest.raises(UsageError, match=r"my_limits:bare takes height without a \* before") as caught:
        etude.load_robot(path, trust=True)
    assert "def limit(spec, model, margins, *, height)" in caught.value.next_step


def test_a_kind_that_is_not_there_is_refused(place) -> None:
    path = place / "arm.toml"
    path.write_text(path.read_text().replace("my_limits:plane", "plain"))
    with pytest.raises(UsageError, match="no limit 'plain'") as refused:
        etude.load_robot(path)
    assert refused.value.where.endswith("arm.toml, limit 1")


def test_what_makes_no_limit_is_named_with_the_protocol(place) -> None:
    path = place / "quad.toml"
    path.write_text(path.read_text().split("[[limit]]")[0] + '[[limit]]\nkind = "my_limits:broken"\n')
    spec = etude.load_robot(path, trust=True)
    said = "object lacks name, cones, penalty, prove, of_motion of the protocol Limit"
    with pytest.raises(UsageError, match=said):
        made_limits(spec.limits, spec, None, {})


def test_python_is_told_how_to_trust_a_robot_file(place) -> None:
    with pytest.raises(UsageError, match="in Python, trust=True") as caught:
        etude.load_robot(place / "arm.toml")
    assert "--robot" in caught.value.next_step
    assert etude.load_robot(place / "arm.toml", trust=True).limits


def test_a_copied_folder_is_not_trusted(place) -> None:
    cli.main(["init", "lab", "--robot", "arm.toml", "--trust"])
    _typed_names.clear()
    Path("lab").rename("moved")
    with pytest.raises(UsageError, match="names code that would be imported"):
        etude.open_campaign(Path("moved"))


class TestWave(LimitSuite):
    """A function that is neither linear nor monotone."""

    limit = LipschitzLimit("wave", "all", lambda q: np.sin(q).sum(axis=1), np.ones(3), -2.5, 2.5, {})
    family, home = FourierFamily.of(FourierConfig(), axes=3), np.zeros(3)


def test_extremes_between_samples_are_held() -> None:
    peak = 0.3141
    at = lambda t: np.exp(-(((t - peak) / 0.01) ** 2))  # noqa: E731
    t = np.linspace(0.0, 1.0, 11)
    least, most = extremes(at, t, at(t), rate=100.0, tolerance=1e-3)
    assert -1e-3 <= least <= 0.0
    assert 1.0 <= most <= 1.0 + 1e-3


def test_tracking_takes_a_margin_by_the_slopes() -> None:
    table = np.array([[0.1, 0.2]])
    slopes, margins = np.array([1.0, 3.0]), {"fourier": (table, 0.9)}
    limit = LipschitzLimit("sum", "all", lambda q: q.sum(axis=1), slopes, -2.0, 2.0, margins)
    low, high, margin, sure = limit.inner("fourier")
    assert (low, high) == (pytest.approx(-1.3), pytest.approx(1.3))
    assert (margin, sure) == (pytest.approx(0.7), 0.9)


@pytest.mark.parametrize("ends", [(1.0, -1.0), (-1.0, np.nan), (-np.inf, 1.0)])
def test_ends_that_say_nothing_are_refused(ends) -> None:
    with pytest.raises(UsageError, match="the limit of sum has the range"):
        LipschitzLimit("sum", "all", lambda q: q.sum(axis=1), np.ones(2), *ends, {})


def reached(**given: Any) -> LipschitzLimit:
    """Of the first two of three coordinates, with the slopes [0.7, 0.3, 0]."""
    own = {"slopes": np.array([0.7, 0.3, 0.0]), "lower": -5.0, "upper": 5.0, "margins": {}, **given}
    return LipschitzLimit("reach", "tool", lambda q: 0.7 * np.sin(q[:, 0]) - 0.3 * q[:, 1], **own)


class TestReached(LimitSuite):
    family, home = FourierFamily.of(FourierConfig(), axes=3), np.zeros(3)
    limit = reached()


class Power:
    """|acceleration times velocity| of each coordinate: a limit of one's own without cones."""

    name = "power"

    def cones(self, family: Any) -> tuple[()]:
        return ()

    def penalty(self, motion: Any) -> None:
        return None

    def of_motion(self, motion: Any) -> Any:
        return motion.orders[1] * motion.orders[2]

    def prove(self, piece: Trajectory) -> list[Proof]:
        power = self.of_motion(piece.motion(np.linspace(0.0, piece.duration, 20_001), 3))
        ends = zip(power.min(axis=0).tolist(), power.max(axis=0).tolist(), strict=True)
        row = partial(Proof, "q", "power", -9.0, 9.0, method="samples", status="sampled")
        return [row(*proved) for proved in ends]


class TestPower(LimitSuite):
    """The suite scales its motions to the limit, so the proof is held where it matters."""

    family, home = FourierFamily.of(FourierConfig(), axes=3), np.zeros(3)
    limit = Power()


def test_a_power_that_is_proved_loosely_is_refused() -> None:
    class Loose(Power):
        def prove(self, piece: Trajectory) -> list[Proof]:
            return [replace(row, proved_upper=row.proved_upper + 1.0) for row in super().prove(piece)]

    suite = type("Suite", (TestPower,), {"limit": Loose()})()
    with pytest.raises(AssertionError, match="the proof of power of q is loose"):
        suite.test_the_proof_holds_what_is_measured()


def said_by_the_suite(wrong: LipschitzLimit) -> AssertionError | None:
    try:
        type("Suite", (TestReached,), {"limit": wrong})().test_slopes_bound_the_function()
    except AssertionError as error:
        return error
    return None


def a_motion(scale: float = 1.0) -> Trajectory:
    family = TestReached.family.drawn(np.random.default_rng(0))
    return family.trajectory(scale * np.random.default_rng(1).standard_normal(family.size))


@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-6, 1.0, 1e3])
def test_right_slopes_are_taken(scale: float) -> None:
    assert reached().prove(a_motion(scale))


@pytest.mark.parametrize("slopes", [[0.7, 0.3], [0.7, 0.3, 0.0, 0.0]])
def test_slopes_of_another_number_than_the_coordinates_are_refused(slopes: list[float]) -> None:
    limit, motion = reached(slopes=np.array(slopes)), a_motion()
    margins = {"fourier": (np.full((3, 3), 0.01), 0.9)}
    poses = motion.motion(np.zeros(1), 1).orders[0]
    for ask in (
        lambda: limit.prove(motion),
        lambda: limit.keeps(motion),
        lambda: limit.strayed(poses, 0.1 * poses),
        lambda: limit.blocked("fourier", poses[0]),
        lambda: reached(slopes=np.array(slopes), margins=margins).prove(motion),
        lambda: reached(slopes=np.array(slopes), coordinates=("a", "b", "c")),
    ):
        with pytest.raises(UsageError, match=f"{len(slopes)} slopes, but the pose has 3 coordinates"):
            ask()
    assert said_by_the_suite(limit) is not None


@pytest.mark.parametrize(
    ("slopes", "axis", "needed"),
    [
        ([0.02, 0.3, 0.0], "first", 0.7),
        ([0.7, 0.01, 0.0], "second", 0.3),
        ([0.6, 0.3, 0.0], "first", 0.7),
        ([0.0, 0.3, 0.7], "first", 0.7),
    ],
)
def test_a_slope_that_is_too_small_is_refused(slopes: list[float], axis: str, needed: float) -> None:
    limit = reached(slopes=np.array(slopes), coordinates=("first", "second", "third"))
    with pytest.raises(UsageError, match=f"the slope of reach in {axis} is 0") as caught:
        limit.prove(a_motion())
    found = re.search(r"is (\S+), but at least (\S+) is needed", str(caught.value))
    assert found
    assert float(found[1]) in slopes
    assert 0.97 * needed <= float(found[2]) <= needed * (1.0 + 1e-6)
    assert said_by_the_suite(limit) is not None


def test_a_slope_that_is_steep_in_places_only_is_found_near_by() -> None:
    """Far pairs see little of it: the function is steep and small."""
    ripple = lambda q: 0.003 * np.sin(1000.0 * q[:, 0])  # noqa: E731
    limit = LipschitzLimit("ripple", "all", ripple, np.full(3, 2.0), -1.0, 1.0, {})
    with pytest.raises(UsageError, match="the slope of ripple in coordinate 1 is 2, but at least"):
        limit.prove(a_motion())


@pytest.mark.parametrize("slopes", [[0.7, -0.3, 0.0], [0.7, np.nan, 0.0], [np.inf, 0.3, 0.0], [[0.7, 0.3]]])
def test_slopes_that_are_no_bounds_are_refused(slopes: list[float]) -> None:
    with pytest.raises(UsageError, match="negative or not a number"):
        reached(slopes=np.array(slopes))


@pytest.mark.parametrize("given", [{"order": 1}, {"order": 2}, {"rest": True}])
def test_what_it_cannot_prove_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="the limit of reach has order"):
        reached(**given)


@pytest.mark.slow
def test_wrong_slopes_in_a_table_name_the_joint(place, capsys) -> None:
    path, right = place / "arm.toml", "reach = [0.75, 0.75, 0.4, 0.1]"
    text = path.read_text()
    for wrong, said in (
        ("reach = [0.75, 0.65, 0.4]", "3 slopes, but the pose has 4 coordinates"),
        ("reach = [0.75, 0.02, 0.4, 0.1]", "slope of height in shoulder is 0.02, but at least"),
    ):
        path.write_text(text.replace(right, wrong))
        folder = f"lab{len(wrong)}"
        assert 2 in {cli.main(["init", folder, "--robot", "arm.toml", "--trust"]), cli.main(["ask", folder])}
        told = " ".join(capsys.readouterr().err.split())
        assert said in told
        assert "my_limits:plane" in told
        assert not list(Path(folder).glob("proposals/0*"))


def test_a_function_that_fails_is_named_as_a_plug_in(place, capsys) -> None:
    code = place / "my_limits.py"
    code.write_text(code.read_text().replace("lambda p: p @ unit", "lambda p: p @ unit[:2]"))
    sys.modules.pop("my_limits", None)
    assert cli.main(["init", "quad", "--robot", "quad.toml", "--trust"]) == 0
    assert cli.main(["ask", "quad"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "function of the limit of wall failed: ValueError" in said
    assert "my_limits:wall" in said
    assert "bug" not in said
    assert "Traceback" not in said


def test_a_plane_below_the_base_is_a_limit_like_any_other() -> None:
    """Without an upper end and below zero: its use is relative to the range that is proved."""
    limit = LipschitzLimit("sum", "all", lambda q: q.sum(axis=1), np.ones(3), -60.0, np.inf, {})
    (row,) = limit.prove(a_motion())
    assert 0.0 < utilization(row) < 1.0
    nearer = replace(row, lower=row.proved_lower)
    assert utilization(nearer) == pytest.approx(1.0)
    assert utilization(replace(row, lower=row.proved_lower + 100.0)) == np.inf


def test_a_limit_with_an_upper_end_alone_is_used_like_its_mirror_image() -> None:
    energy = Proof("arm", "energy", -np.inf, 3.0, 0.0, 2.4, "samples", "sampled")
    assert utilization(energy) == pytest.approx(0.8)
    assert utilization(replace(energy, proved_upper=3.0)) == pytest.approx(1.0)
    height = Proof("tool", "height", -2.0, np.inf, -1.5, 0.5, "samples", "sampled")
    depth = Proof("tool", "depth", -np.inf, 2.0, -0.5, 1.5, "samples", "sampled")
    assert 0.0 < utilization(height) < 1.0
    assert utilization(depth) == pytest.approx(0.75)
    assert utilization(replace(depth, upper=-0.5, proved_upper=-1.0, proved_lower=-2.0)) == pytest.approx(
        utilization(replace(height, lower=0.5, proved_lower=1.0, proved_upper=2.0))
    )
