"""The page: complete, self-contained, true to the journal, and calm when something is missing."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from page import Page
from synthetic_campaign import (
    BASELINES,
    CONFIG,
    SECONDS,
    BumpModel,
    decode_png,
    error_after,
    spec,
    write_campaign,
)

from etude.errors import UsageError
from etude.logs import read_log_file, write_log
from etude.report import build_report, number
from etude.report import record as record_module
from etude.report.build import CONTENTS, SECTIONS
from etude.report.record import read_record
from etude.report.sections.model_scores import deviation_maps, map_panel
from etude.types import Log
from journal_facts import commit

JOINTS = set(CONTENTS) - {"paths", "motion", "confirmation"}
"""Sections of a robot without a model file, whose path is none through space, where nothing was confirmed."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder)
    return folder


def drawn(folder: Path) -> Page:
    path = build_report(folder)
    assert path == folder / "report.html"
    return Page(path.read_text(encoding="utf-8"))


def test_the_page_asks_for_nothing_outside_itself(campaign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_module.Record, "model", lambda self, number: BumpModel(spec()))
    page = drawn(campaign)
    assert page.addresses
    assert all(address.startswith(("#", "data:")) for address in page.addresses)
    source = (campaign / "report.html").read_text()
    assert not re.search(r"@import|url\((?!data:)|https?://", source)
    assert "fetch(" not in source
    assert "XMLHttpRequest" not in source


def test_the_page_has_every_section_and_its_contents_lead_there(campaign: Path) -> None:
    page = drawn(campaign)
    assert {draw.__name__ for draw in SECTIONS} == set(CONTENTS)
    assert page.identifiers >= JOINTS
    assert {address[1:] for address in page.addresses if address.startswith("#")} == JOINTS


def test_the_headline_says_the_journals_numbers(campaign: Path) -> None:
    text = drawn(campaign).text
    assert f"After 5 trajectories ({5 * SECONDS:g} s of robot time)" in text
    assert f"mean error of {number(error_after(5))}°" in text
    for name, error in BASELINES.items():
        assert f"{number(error)}°" in text, name
    assert f"({number(BASELINES['pd'] / error_after(5), 2)} times as much)" in text


def test_every_evaluation_in_the_journal_is_in_the_page(campaign: Path) -> None:
    text = drawn(campaign).text
    for _, run in read_record(campaign).state.evaluated:
        for value in run.errors:
            assert number(value) in text


def test_every_score_of_the_newest_ladder_is_in_the_page(campaign: Path) -> None:
    trained = read_record(campaign).state.trained[-1].trained
    text = drawn(campaign).text
    assert trained is not None
    for scores in trained.models.values():
        assert number(float(np.mean(scores.z2))) in text
        for value in scores.nmse:
            assert number(value) in text


def test_every_proof_of_every_certificate_is_in_the_page(campaign: Path) -> None:
    text = drawn(campaign).text
    files = sorted(campaign.glob("proposals/*/certificate.json"))
    assert len(files) == 6
    for path in files:
        for row in json.loads(path.read_text())["rows"]:
            interval = f"{row['proved_lower']:.4g} … {row['proved_upper']:.4g}".replace("-", "−")
            assert interval in text


def test_each_trajectory_says_how_it_was_chosen(campaign: Path) -> None:
    assert drawn(campaign).text.count("How it was chosen: converged.") == 6


def test_a_certificate_that_fails_says_so(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=0, evaluated=False)
    path = tmp_path / "proposals/0001/certificate.json"
    content = json.loads(path.read_text())
    content["ok"] = False
    content["rows"][0]["slack"] = -0.3
    path.write_text(json.dumps(content))
    assert f"{path.relative_to(tmp_path)} could not be read: it was changed" in drawn(tmp_path).text
    commit(tmp_path, "exported", 1, CONFIG, [path])
    page = drawn(tmp_path)
    assert "NOT proved inside its limits" in page.text
    assert "−33 %" in page.text


def test_the_tracking_error_drawn_is_that_of_the_last_log(campaign: Path) -> None:
    log = read_record(campaign).log(5)
    assert log is not None
    moving = log.t >= 0.0
    mean = np.degrees(np.abs(log["q_des"] - log["q_true"])[moving].mean(axis=0))
    text = drawn(campaign).text
    for name, value in zip(log.channels["q"].parts, mean, strict=True):
        assert f"{name}: tracking error, mean {value:.3g}°" in text


def test_names_are_text_and_never_markup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hostile = spec(("<script>", "a&b", '"quoted"', "</svg>"))
    write_campaign(tmp_path, rounds=2, robot=hostile)
    monkeypatch.setattr(record_module.Record, "model", lambda self, number: BumpModel(hostile))
    page = drawn(tmp_path)
    assert page.tags.count("script") == 1
    for name in hostile.names:
        assert name in page.text


def test_a_campaign_without_evaluation_shows_held_out_scores(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=3, evaluated=False)
    text = drawn(tmp_path).text
    trained = read_record(tmp_path).state.trained[-1].trained
    assert trained is not None
    error = float(np.mean(trained.models["identified+gp"].nmse))
    linear = float(np.mean(trained.models["linear"].nmse))
    assert f"explained {number(100 * (1 - error))} % of the variance" in text
    assert f"Linear regression on the same data explained {number(100 * (1 - linear))} %" in text


@pytest.mark.parametrize(
    ("rounds", "sentence"),
    [
        (0, "1 trajectory has been proposed, but no log was ingested yet"),
        (1, "the first score comes with the second log"),
    ],
)
def test_a_young_campaign_says_what_is_still_missing(tmp_path: Path, rounds: int, sentence: str) -> None:
    write_campaign(tmp_path, rounds=rounds, evaluated=False)
    page = drawn(tmp_path)
    assert sentence in page.text
    assert page.identifiers >= JOINTS


def test_a_campaign_with_nothing_but_a_configuration_still_has_a_page(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text("seed = 1\n")
    page = drawn(tmp_path)
    assert "There is no trajectory yet" in page.text
    assert "the campaign could not be opened" in page.text


def test_damaged_files_are_named_and_the_rest_is_drawn(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2)
    (tmp_path / "runs/0002.parquet").write_bytes(b"not parquet")
    (tmp_path / "proposals/0001/trajectory.json").write_text("{")
    (tmp_path / "proposals/0002/certificate.json").write_text("[]")
    text = drawn(tmp_path).text
    for name in ("runs/0002.parquet", "proposals/0001/trajectory.json", "proposals/0002/certificate.json"):
        assert f"{name} could not be read" in text
    assert "The newest log, number 1." in text


def test_a_log_of_a_real_robot_needs_no_desired_motion(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2, evaluated=False)
    path = tmp_path / "runs/0002.parquet"
    bare = ("q_des", "qd_des", "qdd_des", "command_ff", "command_fb", "q_true")
    write_log(path, read_log_file(path).without(*bare))
    commit(tmp_path, "exported", 2, CONFIG, [path])
    text = drawn(tmp_path).text
    assert "no desired position" in text
    assert "no separate feedforward" in text


def test_repairs_are_listed_per_log(campaign: Path) -> None:
    assert drawn(campaign).text.count("dropped 3 repeated samples") == 5


def test_a_folder_that_is_no_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no campaign here"):
        build_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_the_page_is_a_function_of_the_folder(campaign: Path) -> None:
    first = build_report(campaign).read_bytes()
    assert build_report(campaign).read_bytes() == first


def test_scores_that_are_missing_for_some_joints_or_kinds_do_not_stop_the_page(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2, evaluated=False)
    commit(tmp_path, "told", 3, CONFIG, [], sha256="3", robot_seconds=SECONDS)
    scores = {"identified": {"nmse": [0.1, None, 0.3, 0.2], "z2": [None] * 4}, "gp": {"nmse": [0.2] * 4}}
    commit(tmp_path, "trained", 3, CONFIG, [], models=scores, chosen="identified", robot_seconds=3 * SECONDS)
    text = drawn(tmp_path).text
    assert "The newest model has no held-out score." in text
    assert "explained 80.0 % of the variance" in text


def test_other_joints_than_the_robots_get_numbers_for_names(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2)
    (tmp_path / "robot.toml").unlink()
    text = drawn(tmp_path).text
    assert "axis 4" in text
    assert "the robot's file does not fit" in text.lower()


def test_logs_told_late_are_listed_in_the_order_they_were_learned(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=0, evaluated=False)
    for order, late in enumerate((3, 2, 1), start=1):
        commit(tmp_path, "told", late, CONFIG, [], sha256=str(late), robot_seconds=SECONDS)
        commit(tmp_path, "trained", late, CONFIG, [], models={}, chosen="gp", robot_seconds=SECONDS * order)
    source = re.sub(r"\s+", "", drawn(tmp_path).text)
    assert "320s20sGP220s40sGP120s60sGP" in source


def test_the_rigid_body_that_counts_is_the_one_identified_last(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2)
    facts = {"baseline": "rigid_body", "test": "fourier", "robot_seconds": 2 * SECONDS}
    commit(tmp_path, "evaluated", 2, CONFIG, [], tracking_error_deg=[0.777] * 4, **facts)
    assert "Identified physics alone has 0.777°" in drawn(tmp_path).text


def test_each_round_says_what_it_bought(campaign: Path) -> None:
    source = (build_report(campaign)).read_text(encoding="utf-8")
    before, after = error_after(2), error_after(3)
    change = f"−{number(100 * (before - after) / before, 2)} %"
    per_minute = f"{number(60 * (before - after) / SECONDS, 2)}°"
    cells = [f"{number(before)}°", f"{number(after)}°", change, per_minute]
    assert "".join(f'<td class="number">{cell}</td>' for cell in cells) in source


@pytest.mark.parametrize(
    ("z2", "coverage", "verdict"),
    [
        ([1.0, 0.6, 2.4, 1.1], [0.95, 0.9, 0.86, 1.0], "every command is inside both bands"),
        ([1.0, 0.4, 2.6, 1.1], [0.95, 0.9, 0.86, 0.8], "outside a band: shoulder, elbow, wrist"),
    ],
)
def test_the_verdict_on_calibration_names_the_joints_outside(
    tmp_path: Path, z2: list[float], coverage: list[float], verdict: str
) -> None:
    write_campaign(tmp_path, rounds=1, evaluated=False)
    scores = {"gp": {"nmse": [0.1] * 4, "z2": z2, "coverage": coverage}}
    commit(tmp_path, "trained", 2, CONFIG, [], models=scores, chosen="gp", robot_seconds=SECONDS)
    assert verdict in drawn(tmp_path).text


def test_an_uncertainty_map_is_bright_where_the_model_is_unsure(tmp_path: Path) -> None:
    robot = spec()

    class Fast(BumpModel):
        """Unsure at high velocity of the elbow only."""

        def predict(self, log: Log) -> tuple[np.ndarray, np.ndarray]:
            return np.zeros_like(log["q"]), np.where(log["qd"] > 0.25, 9.0, 1.0)

    data = (np.zeros((3, 4)), np.zeros((3, 4)))
    ranges = np.stack([robot.lower, robot.upper]), np.stack([-robot.velocity, robot.velocity])
    elbow = deviation_maps(Fast(robot), data, ranges)[2]
    assert np.all(elbow[-5:] == 3.0)
    assert np.all(elbow[:5] == 1.0)
    write_campaign(tmp_path, rounds=0, evaluated=False)
    picture = re.search(r"base64,([^\"]+)", map_panel(read_record(tmp_path), 2, elbow, data, ranges))
    assert picture is not None
    pixels = decode_png(picture[1])
    assert pixels[0].sum() > pixels[-1].sum()


def test_the_prediction_drawn_is_that_of_the_model_before_the_newest_log(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def model(self: record_module.Record, number: int) -> BumpModel:
        asked.append(number)
        return BumpModel(spec())

    monkeypatch.setattr(record_module.Record, "model", model)
    text = drawn(campaign).text
    assert 4 in asked
    assert "Log 5, predicted by the model trained on the earlier logs" in text


def test_a_recorded_test_run_is_preferred_to_a_training_log(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=2)
    log = read_record(tmp_path).log(1)
    assert log is not None
    for name, baseline, number_ in (("pd", {"baseline": "pd"}, 0), ("learned", {}, 2)):
        path = tmp_path / "tests" / f"{name}.parquet"
        write_log(path, log)
        facts = {"test": "fourier", "robot_seconds": 2 * SECONDS, "tracking_error_deg": [1.0] * 4}
        commit(tmp_path, "evaluated", number_, CONFIG, [path], **facts, **baseline)
    text = drawn(tmp_path).text
    assert "The last test run, after round 2" in text
    assert "with feedforward" in text


def test_a_run_without_feedforward_is_not_said_to_have_one(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=1, evaluated=False)
    path = tmp_path / "runs/0001.parquet"
    log = read_log_file(path)
    write_log(path, log.put(log.channels["command_ff"], np.zeros_like(log["command"])))
    commit(tmp_path, "exported", 1, CONFIG, [path])
    assert "run without a feedforward" in drawn(tmp_path).text


def test_one_real_log_is_scored_on_its_held_out_blocks(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=0, evaluated=False)
    nmse = {"gp": [0.011, 0.012, 0.013, None], "linear regression": [0.31, 0.32, 0.33, None]}
    blocks = {"blocks": [1, 3], "of": 5, "chosen": "gp", "nmse": nmse}
    facts = {"models": {}, "chosen": "gp", "robot_seconds": 60.0, "held_out": blocks}
    commit(tmp_path, "trained", 2, CONFIG, [], **facts)
    text = drawn(tmp_path).text
    assert "explained" not in text
    assert "the first score comes with the second log" in text
    assert "cut into 5 blocks" in text
    assert "may be many times as large" in text
    for value in (0.011, 0.012, 0.013, 0.31, 0.32, 0.33):
        assert number(value) in text


def test_logs_left_out_are_the_first_score_that_is_told(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=0, evaluated=False)
    used = {"nmse": [0.011, 0.012, 0.013, 0.012], "z2": [1.0] * 4, "coverage": [0.95] * 4}
    found = {"logs": 3, "used": used, "linear": [0.31, 0.32, 0.33, 0.32]}
    facts = {"models": {}, "chosen": "mixed", "robot_seconds": 60.0, "new_motion": found}
    commit(tmp_path, "trained", 2, CONFIG, [], **facts)
    text = drawn(tmp_path).text
    assert "explained 98.8 % of the variance" in text
    assert "Linear regression on the same data explained 68.0 %" in text


def test_calibration_is_that_of_the_model_that_predicted(tmp_path: Path) -> None:
    write_campaign(tmp_path, rounds=0, evaluated=False)
    good, bad = ({"nmse": [0.1] * 4, "z2": [z2] * 4, "coverage": [0.95] * 4} for z2 in (1.0, 9.0))
    facts = {"models": {"gp": good, "identified": bad}, "chosen": "identified", "predicted_by": "gp"}
    commit(tmp_path, "trained", 2, CONFIG, [], **facts, robot_seconds=60.0)
    assert "every command is inside both bands" in drawn(tmp_path).text
