"""Student's t against SciPy's, and its two parameters found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

from etude.models import fit_student
from etude.models.student_t import StudentT


def test_its_density_is_scipys() -> None:
    ratio = np.linspace(-5.0, 5.0, 11)
    for nu, scale in ((2.5, 0.7), (50.0, 2.0)):
        np.testing.assert_allclose(StudentT(nu, scale).log_density(ratio), t.logpdf(ratio, nu, scale=scale))


@pytest.mark.parametrize("nu", [3.0, 200.0])
def test_it_is_found_again(nu: float) -> None:
    ratio = 1.7 * np.random.default_rng(0).standard_t(nu, size=20000)
    found = fit_student(ratio)
    assert found is not None
    assert found.scale == pytest.approx(1.7, rel=0.03)
    assert found.freedom == nu if nu < 10 else found.freedom >= 50.0


def test_no_errors_have_no_distribution() -> None:
    assert fit_student(np.zeros(0)) is None
    assert fit_student(np.zeros(5)) is None
