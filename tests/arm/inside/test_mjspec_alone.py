"""Why files are rewritten before MuJoCo's MjSpec has them: docs/decisions/0059-two-loading-paths.md."""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np
import pytest
from loading_examples import example_robot

from etude_arm.loading.compiled_model_check import SHARE

BODY = """<mujoco><worldbody><body><joint axis="0 0 1"/>
<inertial mass="1.23456789" pos="0.1 0 0" diaginertia="0.0123 0.013 0.014"/></body></worldbody></mujoco>"""


def test_a_spec_that_is_written_and_read_is_another_robot() -> None:
    """By more than the compiled model may differ from its description."""
    spec = mujoco.MjSpec.from_string(BODY)
    masses = [own.compile().body_mass[1] for own in (spec, mujoco.MjSpec.from_string(spec.to_xml()))]
    assert masses[0] == 1.23456789
    assert abs(masses[1] / masses[0] - 1.0) > SHARE


@pytest.mark.slow
def test_few_urdf_files_load_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    reasons: Counter[str] = Counter()
    for path in sorted(example_robot(".").rglob("*.urdf")):
        try:
            mujoco.MjSpec.from_file(str(path)).compile()
            reasons["loads"] += 1
        except ValueError as problem:
            reasons["mesh" if "opening file" in str(problem) else "inertia"] += 1
    with capsys.disabled():
        print(dict(reasons))
    assert reasons["loads"] < 0.25 * np.sum(list(reasons.values()))
