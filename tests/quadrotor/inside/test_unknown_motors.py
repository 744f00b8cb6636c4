"""A vehicle whose motors are not described leaves as C99 and is asked with plain arrays."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from c_models import QUADROTOR, quadrotor_log, quadrotor_model, quadrotor_spec

from etude.deploy import CForm, c_files
from etude.errors import UsageError
from etude_quadrotor.physics.linear_inverse import identify_linear


def test_a_vehicle_of_unknown_motors_is_asked_with_plain_arrays_and_exported_with_its_axes() -> None:
    spec = quadrotor_spec("quadrotor")
    log, whole = quadrotor_log(spec, 40), quadrotor_model("quadrotor", spec=spec)
    mean = identify_linear(log)  # looks at a body_acceleration that the inputs do not hold
    model = replace(whole, candidates=(replace(whole.candidates[0], mean=mean),))
    states = {name: log[name] for name in log.channels if name != "command"}
    np.testing.assert_array_equal(model.predict(states)[0], model.predict(log)[0])
    with pytest.raises(UsageError, match="no 'body_acceleration'"):
        model.predict({name: values for name, values in states.items() if name != "body_acceleration"})
    text = c_files(model, QUADROTOR, spec, CForm(), "quad").files["quad.h"].decode()
    assert "x forward, y left, z up" in text
    assert "set-points" in text
    (line,) = (line for line in text.splitlines() if re.match(r" +\d+ body_acceleration_x ", line))
    assert line.endswith("(not known)")
    assert all(len(line) <= 120 for line in text.splitlines())
