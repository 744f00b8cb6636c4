"""The page of a campaign whose path goes through space: true to its files, calm when something is missing."""

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

from etude import ask
from etude.campaign import (
    chained,
    create_campaign,
    event_to_json,
    open_campaign,
    read_events,
    simulate,
    stored_model,
)
from etude.report import build_report, number
from etude.report import record as curves
from etude.report.build import CONTENTS
from etude.report.markup import duration, with_unit
from etude.report.pictures import write_picture
from etude.report.png import VIRIDIS
from etude.report.record import read_record
from etude.report.scene import Path as Flown
from etude.report.scene import SceneBox, project, room_of, scene
from etude.report.sections import paths
from etude.report.sections.paths import DRAWING, DrawnMotion, equal_limits, shades
from etude.report.sections.prediction import Z95, ExpectedError, expected_error, newest_expected_error
from etude.storage import sha256_of
from etude.types import Channel, Log, Samples

QUICK = {"duration": 8.0, "candidates": 8, "steps": 4, "starts": 1, "points": 60, "refine": 1}
ROUNDS = 2
ROOM = SceneBox((-9.0, -9.0, 0.0), (9.0, 9.0, 5.0))
PILLAR = SceneBox((-3.0, -3.0, 0.0), (3.0, 3.0, 4.0), radius=2.5)


def made(path: Path) -> Path:
    create_campaign(path, "quadrotor_rough", seed=5)
    text = (path / "campaign.toml").read_text()
    for key, value in QUICK.items():
        text = re.sub(rf"^{key} = [\d.]+", f"{key} = {value}", text, flags=re.MULTILINE)
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
            files = {name: sha256_of(folder / name) for name in event.files if (folder / name).is_file()}
            lines.append(chained(event_to_json(replace(event, files={**event.files, **files})), lines))
    journal.write_text("\n".join(lines) + "\n")
    shutil.rmtree(folder / "tests")
    return folder


def test_the_page_is_complete_and_asks_for_nothing_outside_itself(flown: Path, page: Page) -> None:
    # a path in space is drawn in its room, nothing was confirmed
    assert page.identifiers == set(CONTENTS) - {"uncertainty", "confirmation"}
    assert all(address.startswith(("#", "data:")) for address in page.addresses)
    source = (flown / "report.html").read_text()
    assert len(source) < 3_000_000
    assert not re.search(r"@import|url\((?!data:)|https?://", source)
    assert "could not" not in page.text


def test_headline_and_table_say_the_journals_distances(flown: Path, page: Page) -> None:
    evaluated = read_record(flown).state.evaluated
    for _, run in evaluated:
        for value in run.errors:
            assert number(value) in page.text
    first = {e.baseline or n: e.errors[-1] for n, e in evaluated if e.test == "uniform"}
    now, seconds = with_unit(first[ROUNDS], "m"), evaluated[-1][1].robot_seconds
    after = f"After {ROUNDS} trajectories ({duration(seconds)} of robot time)"
    assert f"{after} the robot follows a random test flight" in page.text
    assert f"a mean error of {now}." in page.text
    assert f"PID control alone has {with_unit(first['pid'], 'm')}" in page.text
    assert f"exact linear drag {with_unit(first['exact_drag'], 'm')}" in page.text


def test_an_evaluation_in_space_stands_for_its_distance(flown: Path) -> None:
    test = curves.tests(read_record(flown))[0]
    run = next(e for _, e in read_record(flown).state.evaluated if e.baseline == "pid")
    pid = test.baseline("pid")
    assert pid is not None
    assert pid.mean == run.errors[3]
    assert pid.parts.tolist() == list(run.errors[:3])


def test_a_single_flight_calibrates_nothing_and_the_page_says_so(page: Page) -> None:
    assert "Uncalibrated:" not in page.text  # of two: each was predicted from the other
    assert "The models that predicted log 2 were not calibrated yet." in page.text


def test_the_band_that_is_drawn_is_counted_right(flown: Path, page: Page) -> None:
    record = read_record(flown)
    found = newest_expected_error(record)
    assert found is not None
    assert f"after round {ROUNDS}" in found[0]
    said = found[1]
    campaign = open_campaign(flown)
    mean, variance = stored_model(campaign, ROUNDS).posterior(said.samples.log)
    inside = np.abs(said.samples.command - mean) <= Z95 * np.sqrt(variance)
    assert f"here it holds {number(100.0 * float(inside[said.samples.moving].mean()))} %" in page.text
    for name in record.outputs:
        assert f"{name.replace('_', ' ')}: error of the prediction" in page.text


def test_no_flight_is_coloured_by_a_model_that_had_learned_it(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[tuple[int, str]] = []
    models = {}
    record = read_record(flown)
    read = type(record).model

    def remembered(self: object, number_: int) -> object:
        model = read(self, number_)  # type: ignore[arg-type]
        models[id(model)] = (number_, model)
        return model

    def noted(record: object, model: object, log: Log) -> ExpectedError:
        said.append((models[id(model)][0], log.source))
        return expected_error(record, model, log)  # type: ignore[arg-type]

    monkeypatch.setattr(type(record), "model", remembered)
    monkeypatch.setattr(paths, "expected_error", noted)
    source = paths.paths(record)
    assert [number_ for number_, _ in said] == [1, ROUNDS]
    assert said[0][1] == "0002.parquet"
    assert said[1][1].startswith("simulated")
    assert "no model at the time of the run" in source


def test_bright_is_where_the_deviation_is_large() -> None:
    t = np.linspace(0.0, 10.0, 50)
    place = np.column_stack([t - 5.0, np.zeros(50), np.full(50, 2.0)])
    command = Channel("command", ("a",), ("V",), "command")
    log = Log(t, {"command": command}, {"command": np.zeros((50, 1))})
    every = np.ones((50, 1), dtype=np.bool_)
    samples = Samples(log, np.zeros(50, dtype=np.int64), every, every)
    deviation = np.where(t < 5.0, 0.01, 0.1)[:, None]
    said = ExpectedError(samples, np.zeros((50, 1)), deviation, place)
    source = paths._scene(DrawnMotion("f", Flown(t, place), said), ROOM, (0.01, 0.1), "V")
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


@pytest.mark.parametrize("room", [ROOM, PILLAR], ids=["box", "pillar"])
def test_a_room_lies_inside_its_drawing_to_scale(room: SceneBox) -> None:
    corners = np.stack(np.meshgrid(*zip(room.lower, room.upper, strict=True), indexing="ij"), -1).reshape(
        -1, 3
    )
    svg = ElementTree.fromstring(scene("room", room, [Flown(np.arange(8.0), corners)]))
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
    assert len(rings) == (0 if room.radius is None else 2)


def test_the_room_is_that_of_the_limits(flown: Path) -> None:
    record = read_record(flown)
    assert record.campaign is not None
    spec = record.campaign.spec
    room = room_of(record.limits, [])
    assert all(low <= stated for low, stated in zip(room.lower, spec.upper, strict=True))
    beyond = Flown(np.zeros(1), np.array([[99.0, 0.0, 1.0]]))
    assert room_of(record.limits, [beyond]).upper[0] == 99.0


def test_a_path_with_holes_or_without_points_does_no_harm() -> None:
    place = np.array([[0.0, 0.0, 1.0], [np.nan, 0.0, 1.0], [1.0, 1.0, 2.0]])
    holed = scene("<b>", ROOM, [Flown(np.arange(3.0), place, np.array([0.0, 0.5, np.nan]))])
    assert "nan" not in holed
    assert "<b>" not in holed
    assert "track" not in scene("t", ROOM, [Flown(np.arange(3.0), np.full((3, 3), np.nan))])


def test_from_above_both_axes_have_one_scale() -> None:
    x, y = np.array([-7.0, 3.0]), np.array([1.0, 2.0])
    (left, right), (low, high) = equal_limits(x, y)
    assert (right - left) / DRAWING[0] == pytest.approx((high - low) / DRAWING[1])
    assert left < -7.0 < 3.0 < right
    assert low < 1.0 < 2.0 < high
    one = equal_limits(np.zeros(2), np.zeros(2))
    assert one[0][1] > one[0][0]


def test_every_proof_of_every_certificate_is_in_the_page(flown: Path, page: Page) -> None:
    found = sorted(flown.glob("proposals/*/certificate.json"))
    assert len(found) == ROUNDS + 1
    for path in found:
        certificate = json.loads(path.read_text())
        for row in certificate["rows"]:
            words = f"{row['proved_lower']:.4g} … {row['proved_upper']:.4g}".replace("-", "−")
            assert words in page.text
        for sentence in certificate["not_verified"]:
            assert sentence in page.text


def panels(folder: Path, title: str) -> list[ElementTree.Element]:
    drawings = re.findall(r"<svg.*?</svg>", (folder / "report.html").read_text(), re.DOTALL)
    return [
        svg for d in drawings if (svg := ElementTree.fromstring(d)).attrib["aria-label"].startswith(title)
    ]


def test_the_view_from_above_is_to_scale_and_that_from_the_side_is_not(flown: Path, page: Page) -> None:
    assert page.tags.count("svg") > 20
    for title, equal in (("From above", True), ("From the side", False)):
        assert panels(flown, title)
        for svg in panels(flown, title):
            xl, xh, xs, xe, yl, yh, ys, ye, *_ = map(float, svg.attrib["data-scale"].split())
            px, py = (xe - xs) / (xh - xl), (ys - ye) / (yh - yl)
            assert (abs(px / py - 1.0) < 0.01) == equal


def test_every_rung_of_the_ladder_has_its_curve(flown: Path, page: Page) -> None:
    assert page.text
    trained = read_record(flown).state.trained[-1].trained
    assert trained is not None
    for title, structures in (
        ("Cross-validation on ingested logs", trained.held_out_mae),
        ("On each new log", trained.models),
    ):
        (svg,) = panels(flown, title)
        words = [text.text for text in svg.iter("text")]
        assert len(structures) >= 4
        for structure in structures:
            assert curves.structure_name(structure) in words


def test_a_real_vehicle_has_held_out_scores_and_its_newest_flight(copy: Path) -> None:
    text = drawn(as_if_real(copy)).text
    assert "This robot has no simulated test" in text
    assert "The newest log, number 2." in text


def test_a_log_without_positions_says_so(copy: Path) -> None:
    from etude.logs import read_log_file, write_log

    for number_ in (1, 2):
        path = copy / "runs" / f"{number_:04d}.parquet"
        write_log(path, read_log_file(path).without("position", "position_des"))
    text = drawn(as_if_real(copy)).text
    assert "No log with positions was ingested yet" in text
    assert "no desired position" in text


def test_damaged_files_are_named_and_the_rest_is_drawn(copy: Path) -> None:
    (copy / "runs/0001.parquet").write_bytes(b"not parquet")
    (copy / "models/0001/model.npz").write_bytes(b"PK\x03\x04 broken")
    text = drawn(copy).text
    assert "runs/0001.parquet could not be read" in text
    assert "models/0001 could not be read" in text


def test_the_learning_curve_stands_alone(flown: Path, tmp_path: Path) -> None:
    svg = write_picture(flown, tmp_path / "curve.svg").read_text()
    assert svg.count('class="panel"') == 2
    ElementTree.fromstring(svg)
