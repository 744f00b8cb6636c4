"""Parameters live in TOML; what cannot be a robot is refused with the place."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from etude.errors import UsageError
from etude_arm.plant.parameters import DATA, ArmParameters, load_parameters

COMPLETE = (DATA / "arm4.toml").read_text(encoding="utf-8")


def _load(folder: Path, text: str) -> ArmParameters:
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return load_parameters("mine", folder)


def test_the_rough_arm_differs_by_ripples_alone() -> None:
    plain, rough = load_parameters("arm4"), load_parameters("arm4_rough")
    assert plain != rough
    for motor in rough.motors:
        assert motor.cogging.amplitude == pytest.approx(0.08 * motor.stall)
        assert motor.friction_ripple.amplitude == pytest.approx(0.35)
    smooth = tuple(
        msgspec.structs.replace(m, cogging=n.cogging, friction_ripple=n.friction_ripple)
        for m, n in zip(rough.motors, plain.motors, strict=True)
    )
    assert msgspec.structs.replace(rough, motors=smooth) == plain


@pytest.mark.parametrize(
    ("old", "new", "fact"),
    [
        ("stall = 40.0", "stall = -40.0", "stall|>"),
        ("stall = 40.0", "stahl = 40.0", "stahl|stall"),
        ("static = 6.0", "static = 3.0", "static >= coulomb"),
        ("moving = [0.07908, -0.01394]", "", "both pivots"),
        ("kp = [700.0,", "kp = [", "one kp"),
        ("timestep = 0.001", "timestep = 0.0", "timestep|> 0"),
        ("gravity = 9.81", "gravity = ", "[Ii]nvalid"),
    ],
)
def test_impossible_parameters_are_refused(tmp_path: Path, old: str, new: str, fact: str) -> None:
    assert COMPLETE.count(old) == 1
    with pytest.raises(UsageError, match=fact) as caught:
        _load(tmp_path, COMPLETE.replace(old, new))
    assert "mine.toml" in caught.value.where


def test_a_variant_of_an_unknown_joint_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm4.toml").write_text(COMPLETE, encoding="utf-8")
    with pytest.raises(UsageError, match="'ankle'"):
        _load(tmp_path, 'base = "arm4"\n[[motors]]\njoint = "ankle"\nstall = 1.0\n')


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nobody"):
        load_parameters("nobody", tmp_path)
