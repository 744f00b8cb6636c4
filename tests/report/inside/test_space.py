"""The motion in space in a real browser: something is drawn, where the robot is, as near as is proved."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from space_campaign import write_space

from chromium import chromium, complaints, open_page, overhang
from etude import cli
from etude.campaign import open_campaign
from etude.errors import UsageError
from etude.report.motion_in_space import in_space
from etude.report.record import read_record
from etude.report.space import page
from etude.trajectories import FourierTrajectory

pytestmark = pytest.mark.browser
PIXELS = """
document.querySelector('figure.space').scene.show(arguments[0]);
const own = document.querySelector('canvas.view'), copy = document.createElement('canvas');
copy.width = own.width; copy.height = own.height;
const context = copy.getContext('2d'); context.drawImage(own, 0, 0);
const all = context.getImageData(0, 0, own.width, own.height).data, seen = {};
for (let i = 0; i < all.length; i += 4) {
  const key = [all[i], all[i + 1], all[i + 2]].map((v) => v >> 4).join(' ');
  seen[key] = (seen[key] || 0) + 4 / all.length;
}
return seen;
"""


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FourierTrajectory]:
    folder = tmp_path_factory.mktemp("lab")
    return folder, write_space(folder, ran=True)


@pytest.fixture(scope="module")
def browser(asked: tuple[Path, FourierTrajectory]) -> Iterator[Any]:
    """With the page open."""
    assert cli.main(["view", str(asked[0])]) == 0
    with chromium() as opened:
        open_page(opened, asked[0] / "view.html", 400, 600)
        yield opened


def scene(browser: Any, call: str, *given: Any) -> Any:
    return browser.execute_script(f"return document.querySelector('figure.space').scene.{call}", *given)


def test_something_is_drawn_that_moves(browser: Any) -> None:
    assert complaints(browser) == []
    assert overhang(browser) == 0, "with names as long as a screen of a phone is wide"
    shares = []
    for time in (0.0, 6.0):
        shares.append(browser.execute_script(PIXELS, time))
    assert sum(share for key, share in shares[0].items() if key != "15 15 15") > 0.05
    assert len(shares[0]) > 20, "shaded faces have many colours"
    assert shares[0] != shares[1]


def poses_of(folder: Path, q: np.ndarray) -> list[np.ndarray]:
    """(3, 4) frames of the links at a pose, by pinocchio."""
    pinocchio = pytest.importorskip("pinocchio", reason="pip install pin")
    model = pinocchio.buildModelFromUrdf(str(folder / "arm.urdf"))
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q)
    return [np.eye(4)[:3], *(np.array(own.homogeneous)[:3] for own in list(data.oMi)[1:])]


def test_parts_are_where_pinocchio_has_them(browser: Any, asked: tuple[Path, FourierTrajectory]) -> None:
    for time in (0.0, 3.217, 11.5):
        scene(browser, "show(arguments[0])", time)
        frames = np.array(scene(browser, "frames()")).reshape(4, 3, 4)
        wanted = poses_of(asked[0], asked[1].motion(np.array([time]), 1).orders[0][0])
        np.testing.assert_allclose(frames, wanted, atol=1e-3)


def test_a_motion_that_was_run_is_replayed_beside_the_plan(
    browser: Any, asked: tuple[Path, FourierTrajectory]
) -> None:
    log = read_record(asked[0]).log(1)
    assert log is not None
    scene(browser, "show(arguments[0])", 6.84)
    real = scene(browser, "real()")
    measured = np.array([np.interp(6.84, log.t, column) for column in log["q"].T])
    np.testing.assert_allclose(real["q"], measured, atol=1e-6)
    frames = np.array(real["frame"]).reshape(4, 3, 4)
    np.testing.assert_allclose(frames, poses_of(asked[0], measured), atol=1e-3)
    assert np.abs(frames - np.array(scene(browser, "frames()")).reshape(4, 3, 4)).max() > 0.01
    shown = "return [...document.querySelectorAll('.joints td.measured')].map((c) => c.textContent)"
    assert browser.execute_script(shown)[0] == f"{np.degrees(real['q'][0]):.1f}°"


def test_distances_are_those_of_the_limit_and_the_table_that_of_the_certificate(
    browser: Any, asked: tuple[Path, FourierTrajectory]
) -> None:
    record = read_record(asked[0])
    found = in_space(record, 1)
    assert found is not None
    assert found.nearest is not None
    k = int(np.argmin(np.abs(found.t - found.nearest["time"])))
    limit = next(own for own in record.limits if own.name == "clearance")
    q = asked[1].motion(found.t[k : k + 1], 1).orders[0]
    row = limit.rows.index(tuple(found.nearest["pair"]))  # type: ignore[attr-defined]
    apart = float(limit.of_motion(asked[1].motion(found.t[k : k + 1], 1))[0, row])  # type: ignore[attr-defined]
    assert found.nearest["distance"] == pytest.approx(apart, abs=1.1e-4), q
    scene(browser, "show(arguments[0])", found.nearest["time"])
    listed = browser.execute_script("return document.querySelector('.nearest li').textContent")
    pair = " and ".join(found.nearest["pair"])
    assert listed == f"{pair}: {1000.0 * found.nearest['distance']:.0f} mm"
    certificate = json.loads((asked[0] / "proposals/0001/certificate.json").read_text())
    proved = {r["axis"]: r["proved_lower"] for r in certificate["rows"] if r["quantity"] == "clearance"}
    cells = browser.execute_script(
        "return [...document.querySelectorAll('.scroll table:not(.joints) tbody tr')]"
        ".map((r) => [...r.cells].map((c) => c.textContent))"
    )
    assert {cell[0] for cell in cells} == set(proved)
    for axis, _, value, *_ in cells:
        assert float(value.replace("−", "-").replace(",", "")) == pytest.approx(
            1000.0 * proved[axis], rel=6e-3
        )


def test_the_page_needs_no_network_and_escapes_what_a_robot_is_called(
    browser: Any, asked: tuple[Path, FourierTrajectory]
) -> None:
    text = (asked[0] / "view.html").read_text(encoding="utf-8")
    assert "http:" not in text
    assert "https:" not in text
    assert len(text) < 3_000_000
    assert browser.execute_script("return performance.getEntriesByType('resource').length") == 0
    assert browser.execute_script("return document.querySelectorAll('img, h1 b, .labels b').length") == 0
    labels = browser.execute_script(
        "return [...document.querySelectorAll('.labels span')].map((s) => s.textContent)"
    )
    assert {"floor", "table </script><b>"} <= set(labels)


def test_it_plays_is_dragged_and_follows_the_slider(browser: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.support.ui import WebDriverWait

    view = browser.find_element("css selector", "canvas.view")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", view)
    scene(browser, "show(0)")
    browser.execute_script("document.querySelector('.play').click()")
    WebDriverWait(browser, 30, poll_frequency=0.05).until(lambda page: scene(page, "time()") > 0.0)
    browser.execute_script("document.querySelector('.play').click()")
    browser.execute_script(
        "const s = document.querySelector('[name=time]'); s.value = 4; s.dispatchEvent(new Event('input'));"
    )
    assert scene(browser, "time()") == 4.0
    before = browser.execute_script(PIXELS, 4.0)
    ActionChains(browser).drag_and_drop_by_offset(view, 60, 30).perform()
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    assert browser.execute_script(PIXELS, 4.0) != before


def test_what_cannot_be_shown_is_said(asked: tuple[Path, FourierTrajectory], capsys: Any) -> None:
    assert cli.main(["view", str(asked[0]), "--proposal", "7"]) == 2
    assert "They are 1." in capsys.readouterr().err
    assert cli.main(["view", str(asked[0]), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["proposal"] == 1
    assert set(facts["nearest"]) == {"pair", "distance", "kept", "time"}
    assert page(read_record(asked[0]), 1)[1].certificate is not None


def test_a_file_that_changed_since_the_proof_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    first.mkdir()
    again.mkdir()
    write_space(first)
    known = open_campaign(first).config_sha256
    assert "This certificate is older than the change of campaign.toml." in page(read_record(first), 1)[0]
    monkeypatch.setattr("synthetic_campaign.CONFIG", known)
    write_space(again)
    assert "This certificate is older than the change" not in page(read_record(again), 1)[0]
    config = again / "campaign.toml"
    config.write_text(config.read_text().replace("duration = ", "duration = 1", 1))
    text = page(read_record(again), 1)[0]
    assert (
        f"the change of campaign.toml. Write another trajectory before the robot moves: etude ask {again} "
        "--new"
    ) in text


def test_a_trajectory_that_was_changed_is_not_shown(tmp_path: Path) -> None:
    write_space(tmp_path)
    path = tmp_path / "proposals" / "0001" / "trajectory.json"
    path.write_text(path.read_text().replace("1", "2", 1))
    with pytest.raises(UsageError, match="cannot be shown") as refused:
        page(read_record(tmp_path), 1)
    assert "changed after Étude stored it" in refused.value.next_step
