"""The page of a flying campaign: true to its files, calm when something is missing, and safe to open."""

from __future__ import annotations

import json
import re
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from page import Page

from etude.campaign.ask import ask
from etude.campaign.chain import chained
from etude.campaign.create import create_campaign
from etude.campaign.folder import open_campaign
from etude.campaign.journal import commit, read_events
from etude.campaign.simulate import simulate
from etude.logs.flight.parquet import read_flight_parquet, write_flight
from etude.models.calibration import NORMAL_95
from etude.models.flight.config import LEAST_FLIGHTS
from etude.report import curves
from etude.report.build import build_report
from etude.report.flights import files, paths
from etude.report.flights.files import Forecast, flight_model, forecast
from etude.report.flights.layout import FLIGHT_CONTENTS, FLIGHT_SECTIONS
from etude.report.flights.paths import Flown, shades
from etude.report.flights.proposals import proofs
from etude.report.flights.scene import Path as FlownPath
from etude.report.flights.scene import project, scene
from etude.report.flights.tracking import DRAWING, distance, equal_limits
from etude.report.markup import duration, number, with_unit
from etude.report.picture import write_picture
from etude.report.png import VIRIDIS
from etude.report.record import read_record
from etude.robots.toml_file import load_robot

QUICK = {
    "duration = 30.0": "duration = 8.0",
    "candidates = 100": "candidates = 8",
    "starts = 8": "starts = 1",
    "steps = 60": "steps = 4",
    "starts = 3": "starts = 1",
    "points = 1200": "points = 60",
}
ROUNDS = 2
QUADROTOR = load_robot("quadrotor").flight
PELICAN = load_robot("pelican").flight


def made(path: Path) -> Path:
    create_campaign(path, "quadrotor_rough", seed=5)
    text = (path / "campaign.toml").read_text()
    for old, new in QUICK.items():
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text)
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights learned and tested, and a third one asked for."""
    folder = made(tmp_path_factory.mktemp("flown") / "lab")
    campaign = open_campaign(folder)
    list(simulate(campaign, ROUNDS))
    ask(campaign, go_on=True)
    return folder


@pytest.fixture
def copy(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(flown, tmp_path / "lab"))


@pytest.fixture(scope="module")
def page(flown: Path) -> Page:
    return drawn(flown)


def drawn(folder: Path) -> Page:
    source = build_report(folder).read_text(encoding="utf-8")
    for drawing in re.findall(r"<svg.*?</svg>", source, re.DOTALL):
        ElementTree.fromstring(drawing)
        numbers = " ".join(re.findall(r' (?:d|x|y|cx|cy|width|height|points|data-scale)="([^"]*)"', drawing))
        assert not re.search(r"nan|inf", numbers, re.IGNORECASE)
    return Page(source)


def as_if_real(folder: Path) -> Path:
    """The folder without its tests, as a vehicle that is not simulated leaves it."""
    journal = folder / "journal.jsonl"
    lines: list[str] = []
    for event in read_events(folder):
        if event.event != "evaluated":
            lines.append(chained(event.to_json(), lines))
    journal.write_text("\n".join(lines) + "\n")
    shutil.rmtree(folder / "tests")
    return folder


def test_the_page_is_complete_and_asks_for_nothing_outside_itself(flown: Path, page: Page) -> None:
    assert len(FLIGHT_CONTENTS) == len(FLIGHT_SECTIONS)
    assert page.identifiers == set(FLIGHT_CONTENTS)
    assert all(address.startswith(("#", "data:")) for address in page.addresses)
    source = (flown / "report.html").read_text()
    assert len(source) < 3_000_000
    assert not re.search(r"@import|url\((?!data:)|https?://", source)
    assert 'class="missing"' in source  # only of what two flights cannot have
    assert "could not" not in page.text


def test_the_script_reads_scales_of_panels_only(flown: Path, page: Page) -> None:
    source = (flown / "report.html").read_text()
    assert page.tags.count("svg") > 20
    for opening in re.findall(r"<svg [^>]*>", source):
        assert ('class="panel"' in opening) == ("data-scale" in opening)


def test_the_page_is_a_function_of_the_folder(flown: Path) -> None:
    first = build_report(flown).read_bytes()
    assert build_report(flown).read_bytes() == first


def test_headline_and_table_say_the_journals_distances(flown: Path, page: Page) -> None:
    evaluated = read_record(flown).state.evaluated
    for event in evaluated:
        for value in event["tracking_error_m"]:
            assert number(value) in page.text
    first = {
        e.get("baseline", e["number"]): e["tracking_error_m"][-1] for e in evaluated if e["test"] == "uniform"
    }
    now, seconds = with_unit(first[ROUNDS], "m"), evaluated[-1]["robot_seconds"]
    after = f"After {ROUNDS} flights ({duration(seconds)} of robot time)"
    assert f"{after} the vehicle follows a random test flight" in page.text
    assert f"a mean error of {now}." in page.text
    assert f"PID control alone has {with_unit(first['pid'], 'm')}" in page.text
    assert f"exact linear drag as well {with_unit(first['exact_drag'], 'm')}" in page.text


def test_an_evaluation_in_metres_stands_for_its_distance(flown: Path) -> None:
    test = curves.tests(read_record(flown))[0]
    facts = next(e for e in read_record(flown).state.evaluated if e.get("baseline") == "pid")
    pid = test.baseline("pid")
    assert pid is not None
    assert pid.mean == facts["tracking_error_m"][3]
    assert pid.parts.tolist() == facts["tracking_error_m"][:3]


def test_two_flights_are_not_calibrated_and_the_page_says_so(page: Page) -> None:
    assert f"Uncalibrated below {LEAST_FLIGHTS} flights" in page.text
    assert "by distance" in page.text
    assert "by clipping" in page.text
    assert "The models that predicted log 2 were not calibrated yet." in page.text


def test_the_band_that_is_drawn_is_counted_right(flown: Path, page: Page) -> None:
    record = read_record(flown)
    model = flight_model(record, ROUNDS)
    event, log = files.tested_flight(record, "uniform", None) or (None, None)
    assert model is not None
    assert event is not None
    assert event.number == ROUNDS
    mean, variance = model.predict(log.states)  # the log is at the model's rate, and has no lag
    inside = np.abs(log.command - mean) <= NORMAL_95 * np.sqrt(variance)
    assert f"here it holds {number(100.0 * float(inside.mean()))} %" in page.text
    for name in record.outputs:
        assert f"{name.replace('_', ' ')}: error of the prediction" in page.text


def test_no_flight_is_coloured_by_a_model_that_had_learned_it(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[tuple[int, str]] = []
    models = {}

    def remembered(record: object, number_: int) -> object:
        model = flight_model(record, number_)  # type: ignore[arg-type]
        models[id(model)] = (number_, model)
        return model

    def noted(record: object, model: object, log: object) -> Forecast:
        said.append((models[id(model)][0], log.source))  # type: ignore[attr-defined]
        return forecast(record, model, log)  # type: ignore[arg-type]

    monkeypatch.setattr(paths, "flight_model", remembered)
    monkeypatch.setattr(paths, "forecast", noted)
    source = paths.paths(read_record(flown))
    assert [number_ for number_, _ in said] == [1, ROUNDS]
    assert said[0][1] == "0002.parquet"
    assert said[1][1].startswith("simulated")
    assert "no model yet when it was flown" in source


def test_bright_is_where_the_deviation_is_large() -> None:
    t = np.linspace(0.0, 10.0, 50)
    place = np.column_stack([t - 5.0, np.zeros(50), np.full(50, 2.0)])
    zeros = np.zeros((50, 4))
    said = Forecast(t, place, zeros, zeros, zeros, np.where(t < 5.0, 0.01, 0.1))
    source = paths._scenes([Flown("f", FlownPath(t, place), said)], QUADROTOR)[0]
    strokes = re.findall(r"stroke:(#\w{6})", source)
    rgb = np.array([[int(s[i : i + 2], 16) for i in (1, 3, 5)] for s in strokes], dtype=float)
    assert len(strokes) == 2
    assert np.abs(rgb[0] - VIRIDIS[0]).max() < 20.0
    assert np.abs(rgb[1] - VIRIDIS[-1]).max() < 40.0
    assert "0.1 V" in source.replace("0.10 V", "0.1 V")


def test_shades_are_logarithmic_and_clipped() -> None:
    found = shades(np.array([0.001, 0.01, 0.1, 1.0, 10.0]), (0.01, 1.0))
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-12)
    assert np.isfinite(shades(np.zeros(3), (0.0, 0.0))).all()


def test_the_projection_is_orthographic() -> None:
    axes = project(np.eye(3))
    assert np.linalg.matrix_rank(axes) == 2
    np.testing.assert_allclose(axes.T @ axes, np.eye(2), atol=1e-12)  # rows of a rotation, two of three
    assert axes[0, 0] > 0.0  # x to the right
    assert axes[1, 1] > 0.0  # y away, up the page
    assert axes[2] @ [1.0, 0.0] == 0.0  # z upright
    assert axes[2, 1] > 0.0


@pytest.mark.parametrize("spec", [QUADROTOR, PELICAN])
def test_a_room_lies_inside_its_drawing_to_scale(spec) -> None:
    corners = np.array([[a, b, c] for a, b, c in zip(spec.lower, spec.upper, spec.lower, strict=True)])
    corners = np.stack(np.meshgrid(*zip(spec.lower, spec.upper, strict=True), indexing="ij"), -1).reshape(
        -1, 3
    )
    svg = ElementTree.fromstring(scene("room", spec, [FlownPath(np.arange(8.0), corners)]))
    width, height = (float(v) for v in svg.attrib["viewBox"].split()[2:])
    track = next(p for p in svg.iter("path") if p.attrib["class"].startswith("track"))
    pixels = np.array([[float(v) for v in pair.split(",")] for pair in track.attrib["d"][1:].split("L")])
    assert (pixels >= 0.0).all()
    assert (pixels <= [width, height]).all()
    flat = project(corners) * [1.0, -1.0]
    scale = np.ptp(pixels, axis=0) / np.ptp(flat, axis=0)
    assert scale[0] == pytest.approx(scale[1], rel=0.01)
    np.testing.assert_allclose(pixels - pixels[0], (flat - flat[0]) * scale[0], atol=0.6)
    rings = [p for p in svg.iter("path") if p.attrib["class"] == "line limit"]
    assert len(rings) == (0 if spec.radius is None else 2)


def test_a_path_with_holes_or_without_points_does_no_harm() -> None:
    place = np.array([[0.0, 0.0, 1.0], [np.nan, 0.0, 1.0], [1.0, 1.0, 2.0]])
    holed = scene("<b>", QUADROTOR, [FlownPath(np.arange(3.0), place, np.array([0.0, 0.5, np.nan]))])
    assert "nan" not in holed
    assert "<b>" not in holed
    assert "track" not in scene("t", QUADROTOR, [FlownPath(np.arange(3.0), np.full((3, 3), np.nan))])


def test_from_above_both_axes_have_one_scale() -> None:
    x, y = np.array([-7.0, 3.0]), np.array([1.0, 2.0])
    (left, right), (low, high) = equal_limits(x, y)
    assert (right - left) / DRAWING[0] == pytest.approx((high - low) / DRAWING[1])
    assert left < -7.0 < 3.0 < right
    assert low < 1.0 < 2.0 < high
    one = equal_limits(np.zeros(2), np.zeros(2))
    assert one[0][1] > one[0][0]


def test_the_distance_drawn_is_the_one_evaluated(flown: Path) -> None:
    record = read_record(flown)
    event, log = files.tested_flight(record, "uniform", "pid") or (None, None)
    assert event is not None
    late = log.t >= 0.5 * log.t[-1]
    assert distance(log)[late].mean() == pytest.approx(event.facts["tracking_error_m"][-1], rel=1e-9)


def test_every_proof_of_every_certificate_is_in_the_page(flown: Path, page: Page) -> None:
    found = sorted(flown.glob("proposals/*/certificate.json"))
    assert len(found) == ROUNDS + 1
    for path in found:
        for row in json.loads(path.read_text())["rows"]:
            if row["quantity"] == "speed":
                assert f"at most {number(row['proved_upper'], 4)} m/s" in page.text
                share = number(100.0 * (1.0 - row["proved_upper"] / row["upper"]), 2)
                assert f"{share} %" in page.text
            else:
                words = f"{row['proved_lower']:.4g} … {row['proved_upper']:.4g}".replace("-", "−")
                assert words in page.text


def test_a_certificate_of_other_quantities_still_has_its_rows() -> None:
    rows = [
        {"axis": "vehicle", "quantity": q, "lower": -1.0, "upper": 1.0, "proved_lower": -0.25,
         "proved_upper": 0.25, "margin": 0.75, "method": "<m>"}
        for q in ("tilt", "radius", "<new>")
    ]  # fmt: skip
    found = proofs({"rows": rows, "ok": True})
    assert "at most 0.2500 rad" in found
    assert found.count('style="left:0.0%;right:75.0%"') == 2  # a size is drawn from 0, the other from -limit
    assert "&lt;new&gt;" in found
    assert "<m>" not in found


def panels(folder: Path, title: str) -> list[ElementTree.Element]:
    drawings = re.findall(r"<svg.*?</svg>", (folder / "report.html").read_text(), re.DOTALL)
    return [
        svg for d in drawings if (svg := ElementTree.fromstring(d)).attrib["aria-label"].startswith(title)
    ]


def test_the_view_from_above_is_to_scale_and_that_from_the_side_is_not(flown: Path) -> None:
    for title, equal in (("From above", True), ("From the side", False)):
        for svg in panels(flown, title):
            xl, xh, xs, xe, yl, yh, ys, ye, *_ = map(float, svg.attrib["data-scale"].split())
            px, py = (xe - xs) / (xh - xl), (ys - ye) / (yh - yl)
            assert (abs(px / py - 1.0) < 0.01) == equal


def test_every_model_of_the_ladder_has_its_curve(flown: Path) -> None:
    trained = read_record(flown).state.trained[-1].trained
    assert trained is not None
    for title, kinds in (
        ("On told flights left out", trained["held_out_mae"]),
        ("On each new log", trained["models"]),
    ):
        (svg,) = panels(flown, title)
        words = [text.text for text in svg.iter("text")]
        assert len(kinds) >= 4
        for kind in kinds:
            assert curves.kind_name(read_record(flown), kind) in words


@pytest.mark.parametrize(
    ("pid", "words"),
    [(0.101, "about the same"), (0.09, "better than what was learned"), (0.5, "5.0 times as much")],
)
def test_the_headline_compares_honestly(tmp_path: Path, pid: float, words: str) -> None:
    folder = made(tmp_path / "lab")
    commit(folder, "told", 1, "0" * 64, [], sha256="1", robot_seconds=10.0, repairs=[])
    commit(folder, "trained", 1, "0" * 64, [], models={}, chosen="gp", robot_seconds=10.0)
    for error, facts in ((pid, {"baseline": "pid"}), (0.1, {})):
        errors = [0.0, 0.0, 0.0, error]
        commit(
            folder,
            "evaluated",
            1,
            "0" * 64,
            [],
            test="uniform",
            robot_seconds=10.0,
            tracking_error_m=errors,
            **facts,
        )
    assert f"PID control alone has {with_unit(pid, 'm')} ({words})." in drawn(folder).text


def test_rings_mark_the_model_in_use(flown: Path) -> None:
    source = (flown / "report.html").read_text()
    # one on the log that was predicted, two where a choice was made, and one in each legend
    assert source.count('class="dot ring"') == (ROUNDS - 1) + ROUNDS + 2


def test_names_are_text_and_never_markup(copy: Path) -> None:
    robot = copy / "robot.toml"
    hostile = robot.read_text().replace('"front_right"', '"</svg><script>"').replace("front_left", "a&b")
    robot.write_text(hostile)
    found = drawn(copy)
    assert found.tags.count("script") == 1
    assert "</svg><script>" in found.text
    assert "a&b" in found.text


def test_a_real_vehicle_has_held_out_scores_and_its_newest_flight(copy: Path) -> None:
    text = drawn(as_if_real(copy)).text
    assert "There is no test flight, which only a simulated vehicle has." in text
    assert "The newest log, number 2." in text
    assert "Log 2, predicted by the model learned from the logs before it." in text
    assert re.search(r"After 2 logs .* explained [\d.]+ % of the variance", text)
    assert "front_right" in text


def test_a_flight_without_positions_says_so(copy: Path) -> None:
    as_if_real(copy)
    for path in (copy / "runs").glob("*.parquet"):
        write_flight(replace(read_flight_parquet(path), position=None, position_des=None), path)
    text = drawn(copy).text
    assert "No flight with positions has come back yet." in text
    assert "Log 2 has no desired position" in text


@pytest.mark.parametrize(
    ("gone", "sentence"),
    [
        ("models", "This needs two flights: one to learn, one to predict."),
        ("runs", "Flight 3"),
        ("tests", "No flight that can be read has come back yet."),
        ("proposals", "The flight's file is missing or unreadable."),
        ("robot.toml", "its room is unknown"),
        ("campaign.toml", "The deviations could not be predicted"),
    ],
)
def test_what_is_missing_is_said(copy: Path, gone: str, sentence: str) -> None:
    path = copy / gone
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    if gone == "tests":
        shutil.rmtree(copy / "runs")
    found = drawn(copy)
    assert sentence in found.text
    assert found.identifiers == set(FLIGHT_CONTENTS)


def test_damaged_files_are_named_and_the_rest_is_drawn(copy: Path) -> None:
    for name in ("runs/0002.parquet", "tests/0002.learned.boundary.parquet", "models/0002/flight_model.npz"):
        (copy / name).write_bytes(b"broken")
    text = drawn(copy).text
    for name in ("runs/0002.parquet", "tests/0002.learned.boundary.parquet", "models/0002"):
        assert f"{name} could not be read" in text
    assert "Distance from the desired position" in text


def test_a_log_of_the_wrong_kind_is_a_note(copy: Path) -> None:
    (copy / "campaign.toml").write_text("seed = 1\n")
    assert "does not describe a vehicle" in drawn(copy).text


def test_a_young_campaign_says_what_is_still_missing(tmp_path: Path) -> None:
    folder = made(tmp_path / "lab")
    assert "Nothing has been asked yet. `etude ask` writes the first flight." in drawn(folder).text
    ask(open_campaign(folder))
    text = drawn(folder).text
    assert "1 flight has been proposed, and no log has come back yet. Run the flight on the vehicle" in text
    assert "No flight with positions has come back yet." in text


def test_the_learning_curve_stands_alone(flown: Path, tmp_path: Path) -> None:
    svg = write_picture(flown, tmp_path / "curve.svg").read_text()
    assert "position error (m)" in svg
    assert "analytic, exact linear drag" in svg


def test_physics_alone_are_coloured_by_what_their_process_does_not_know(flown: Path) -> None:
    record = read_record(flown)
    model = files.flight_model(record, 1)
    log = files.told_flight(record, 2)
    assert model is not None
    assert log is not None
    assert model.kind == "identified"  # one flight is learned by physics alone
    said = forecast(record, model, log)
    assert np.ptp(said.deviation, axis=0).max() == 0.0
    assert np.ptp(said.spread) > 0.0
