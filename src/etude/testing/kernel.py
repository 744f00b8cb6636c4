"""What every kernel owes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernels import Kernel
from etude.testing.differences import central, close, same
from etude.types import Array


class KernelSuite:
    """Laws of `models.gp.kernels.Kernel`. Set `kernel`, and `width`, how many inputs it may look at.

    With `noisy`, samples have noise of their own: `gram` has more on its diagonal than `cross`, of which that
    is all that may differ.
    """

    kernel: ClassVar[Kernel]
    width: ClassVar[int] = 8
    noisy: ClassVar[bool] = False

    def inputs(self, n: int, seed: int) -> Array:
        """(n, width) random inputs."""
        X = np.random.default_rng(seed).normal(size=(n, self.width))
        return np.asarray(X * np.linspace(0.5, 2.0, self.width))

    @property
    def theta(self) -> Array:
        """Random log hyperparameters."""
        return np.random.default_rng(self.kernel.size).normal(size=self.kernel.size) * 0.5

    def _among(self, theta: Array, X: Array) -> Array:
        """(n, n) cross of X with itself, plus the noise that `noisy` allows."""
        shared = self.kernel.value(theta, X, X)
        if not self.noisy:
            return shared
        own = self.kernel.diagonal(theta, X) - shared.diagonal()
        assert np.all(own >= -1e-11 * shared.diagonal()), "noise is no negative variance"
        return np.asarray(shared + np.diag(own))

    def test_names_roles_and_start_have_the_length_of_theta(self) -> None:
        kernel = self.kernel
        start = kernel.initial(np.linspace(0.5, 2.0, self.width), 3.0)
        assert len(set(kernel.names())) == kernel.size, "names are distinct, one for each hyperparameter"
        assert len(kernel.roles()) == kernel.size, "one role for each hyperparameter"
        assert start.shape == (kernel.size,), "one start for each hyperparameter"
        assert np.isfinite(start).all(), "the training starts from numbers"

    def test_gram_cross_and_diagonal_agree(self) -> None:
        kernel, X, theta = self.kernel, self.inputs(9, 0), self.theta
        K = kernel.gram(theta, X)[0]
        assert K.shape == (9, 9), "gram is (n, n)"
        close(self._among(theta, X), K, 1e-11, "cross of X with itself")
        close(kernel.diagonal(theta, X), K.diagonal(), 1e-11, "diagonal")
        close(K.T, K, 1e-11, "symmetry")
        Z = self.inputs(4, 1)
        close(kernel.value(theta, X, Z), kernel.value(theta, Z, X).T, 1e-11, "cross, both ways")

    def test_positive_semidefinite(self) -> None:
        K = self.kernel.gram(self.theta, self.inputs(40, 2))[0]
        assert np.linalg.eigvalsh(K).min() > -1e-10 * K.diagonal().mean(), (
            "a covariance has no negative direction"
        )

    def test_theta_gradient(self) -> None:
        kernel, X, theta = self.kernel, self.inputs(7, 3), self.theta
        G = np.random.default_rng(4).normal(size=(7, 7))
        expected = central(lambda t: float(np.sum(G * self._among(t, X))), theta)
        close(kernel.theta_gradient(theta, X, G), expected, 1e-6, "gradient in theta")

    def test_input_gradient(self) -> None:
        kernel, X, Z, theta = self.kernel, self.inputs(6, 5), self.inputs(5, 6), self.theta
        G = np.random.default_rng(7).normal(size=(6, 5))
        expected = central(lambda x: float(np.sum(G * kernel.value(theta, x, Z))), X)
        close(kernel.input_gradient(theta, X, Z, G), expected, 1e-6, "gradient in the inputs")

    def test_diagonal_gradient(self) -> None:
        kernel, X, theta = self.kernel, self.inputs(6, 8), self.theta
        g = np.random.default_rng(9).normal(size=6)
        expected = central(lambda x: float(g @ kernel.diagonal(theta, x)), X)
        close(kernel.diagonal_gradient(theta, X, g), expected, 1e-6, "gradient of the diagonal")

    def test_pulls_can_be_called_twice(self) -> None:
        kernel, X, theta = self.kernel, self.inputs(5, 10), self.theta
        G = np.random.default_rng(11).normal(size=(5, 5))
        for _, pull in (kernel.gram(theta, X), kernel.cross(theta, X, X)):
            same(pull(G), pull(G), "a pull called twice")

    def test_wrong_theta_is_refused(self) -> None:
        for theta in (np.zeros(self.kernel.size + 1), np.full(self.kernel.size, np.nan)):
            try:
                self.kernel.value(theta, self.inputs(2, 0), self.inputs(2, 0))
            except UsageError:
                continue
            raise AssertionError(f"hyperparameters {theta} are not refused")
