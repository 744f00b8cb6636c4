"""Faults by their name: a pose that no motion can be begun from, a file that holds no motion."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.campaign import open_campaign
from etude.campaign.deployment.model_export import bounded_motion
from etude.cli import main
from etude.errors import DataError

ROBOT = Path(__file__).parents[3] / "examples" / "px4" / "px4_quad.toml"


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("advice") / "sky"
    assert main(["init", str(folder), "--robot", str(ROBOT)]) == 0
    assert main(["ask", str(folder)]) == 0
    return folder


def test_a_pose_within_the_margin_is_named_as_the_fault(
    asked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No other motion would help: the open one is not to be abandoned."""
    assert main(["ask", str(asked), "--from", "x=9.9,y=0,z=2"]) == 4
    said = " ".join(capsys.readouterr().err.split())
    assert "pose itself is the problem: position of 'x' is 9.9" in said
    assert "-9..9, 1 inside of -10..10" in said
    assert "abandon" not in said


@pytest.mark.parametrize(
    ("text", "said"),
    [("time,x\n0,0\n", "1 rows"), ("time,x\n" + "".join(f"{0.1 * k},0\n" for k in range(20)), "of y, z")],
)
def test_a_table_that_is_no_motion_is_named(asked: Path, text: str, said: str) -> None:
    table = asked / "m1.csv"
    table.write_text(text)
    with pytest.raises(DataError) as found:
        bounded_motion(open_campaign(asked), table)
    assert table.name in str(found.value.where)
    assert said in str(found.value)
