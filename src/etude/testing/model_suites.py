"""Laws of kernels, members of the model family and design criteria."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from etude.design.criteria import Criterion, Output, evaluate, value_of
from etude.errors import UsageError
from etude.models.config import ModelConfig
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import Kernel, SquaredExponential, structured
from etude.protocols import FitData, Member, Process
from etude.testing.differences import central, close, same
from etude.types import Array, Column

COLUMNS: tuple[Column, ...] = tuple(("q", f"joint{i}", "rad", "") for i in range(3))


class ProcessSuite:
    """Laws of `protocols.Process` and of its member. Set `member` (a staticmethod unless it is an object)."""

    member: ClassVar[Member]
    commands: ClassVar[int] = 1
    covariances: ClassVar[bool] = True
    """False for a member without covariances between inputs: designs see its guide."""

    def data(self, n: int = 90, seed: int = 0) -> FitData:
        """Samples of a smooth function in three groups."""
        rng = np.random.default_rng(seed)
        X = rng.uniform(-1.0, 1.0, (n, 3))
        Y = np.column_stack([np.sin(2.0 * X[:, 0] + j) + X[:, 1] * X[:, 2] for j in range(self.commands)])
        Y += 0.05 * rng.standard_normal(Y.shape)
        every = np.ones(Y.shape, dtype=np.bool_)
        return FitData(
            X=X,
            Y=Y - Y.mean(axis=0),
            usable=every,
            moving=every,
            group=np.repeat(np.arange(3), -(-n // 3))[:n].astype(np.int64),
            fold=np.repeat(np.arange(3), -(-n // 3))[:n].astype(np.int64),
            chosen=np.arange(0, n, 2),
            kept=np.arange(n),
            columns=COLUMNS,
            commands=tuple(f"command{j}" for j in range(self.commands)),
            kernels=[SquaredExponential((0, 1, 2))],
            floor=np.full(self.commands, 0.02),
            start=None,
            config=ModelConfig(points=n, basis=20, steps=15, kernel="ard_se"),
            rng=np.random.default_rng(1),
        )

    def fitted(self) -> Process:
        return type(self).member(self.data())

    def elsewhere(self, n: int = 12) -> Array:
        """Inputs (n, 3) that were not learned."""
        return np.random.default_rng(9).uniform(-0.9, 0.9, (n, 3))

    def test_shapes_and_numbers(self) -> None:
        mean, variance = self.fitted().predict(self.elsewhere())
        for name, values in (("mean", mean), ("variance", variance)):
            assert values.shape == (12, self.commands), f"{name} has shape {values.shape}"
            assert np.isfinite(values).all(), f"{name} has numbers that are not finite"
        assert np.all(variance >= 0.0), "a variance is negative"

    def test_it_learned_something(self) -> None:
        data, Z = self.data(), self.elsewhere(200)
        truth = np.column_stack([np.sin(2.0 * Z[:, 0] + j) + Z[:, 1] * Z[:, 2] for j in range(self.commands)])
        error = self.fitted().predict(Z)[0] - truth
        assert np.mean(error**2) < 0.5 * np.mean(data.Y**2), "no better than predicting the mean"

    def test_the_same_data_teach_the_same(self) -> None:
        Z = self.elsewhere()
        same(self.fitted().predict(Z)[0], self.fitted().predict(Z)[0], "two trainings with one seed")

    def test_rows_do_not_depend_on_their_company(self) -> None:
        process, Z = self.fitted(), self.elsewhere()
        close(process.predict(Z[[5, 2]])[0], process.predict(Z)[0][[5, 2]], 1e-9, "rows alone")

    def test_held_out_is_conditioning_without(self) -> None:
        """With hyperparameters as they are: what the process says of a group does not know that group."""
        data, process = self.data(), self.fitted()
        rows = np.flatnonzero(data.group == 1)
        mean, variance = process.held_out(rows)
        assert mean.shape == variance.shape == (len(rows), self.commands), (
            "one prediction for each sample left out"
        )
        spoiled = data.Y.copy()
        spoiled[rows] += 100.0
        again, _ = process.held_out(rows, spoiled)
        close(again, mean, 1e-6, "what is said of a group when only that group's outputs change")
        assert np.all(variance > 0.0), "held-out variances include the noise"

    def test_restored_from_its_arrays_it_is_the_same(self) -> None:
        process, Z = self.fitted(), self.elsewhere()
        restored: Process = type(self).member.restore(process.arrays())
        for name, actual, expected in zip(
            ("mean", "variance"), restored.predict(Z), process.predict(Z), strict=True
        ):
            same(actual, expected, f"{name} after storing")

    def test_latents_have_their_gradients(self) -> None:
        if not self.covariances:
            return
        Z = self.elsewhere(4)
        G, g = np.random.default_rng(2).standard_normal((4, 5)), np.linspace(0.5, 2.0, 4)
        R = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 3))
        covered: list[int] = []
        for posterior, commands in self.fitted().latents():
            covered += commands
            close(
                posterior.covariance_gradient(Z, R, G),
                central(lambda x, p=posterior: float(np.sum(G * p.covariance(x, R))), Z),  # type: ignore[misc]
                1e-5,
                "gradient of the covariance",
            )
            close(
                posterior.variance_gradient(Z, g),
                central(lambda x, p=posterior: float(g @ p.predict(x)[1]), Z),  # type: ignore[misc]
                1e-5,
                "gradient of the variance",
            )
        assert sorted(covered) == list(range(self.commands)), "each command has its latent function"

    def test_a_larger_floor_means_more_noise(self) -> None:
        small = self.fitted()
        large = type(self).member(replace(self.data(), floor=np.full(self.commands, 0.5)))
        rows = np.arange(30)
        assert large.held_out(rows)[1].mean() > small.held_out(rows)[1].mean(), (
            "the noise floor is not heeded"
        )


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

    def _covariance(self, theta: Array, X: Array) -> Array:
        """(n, n) cross of X with itself, plus the noise that `noisy` allows."""
        shared = self.kernel.value(theta, X, X)
        if not self.noisy:
            return shared
        noise = self.kernel.diagonal(theta, X) - shared.diagonal()
        assert np.all(noise >= -1e-11 * shared.diagonal()), "noise is no negative variance"
        return np.asarray(shared + np.diag(noise))

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
        close(self._covariance(theta, X), K, 1e-11, "cross of X with itself")
        close(kernel.diagonal(theta, X), K.diagonal(), 1e-11, "diagonal")
        close(K.T, K, 1e-11, "symmetry")
        Z = self.inputs(4, 1)
        close(kernel.value(theta, X, Z), kernel.value(theta, Z, X).T, 1e-11, "cross, in both directions")

    def test_positive_semidefinite(self) -> None:
        K = self.kernel.gram(self.theta, self.inputs(40, 2))[0]
        assert np.linalg.eigvalsh(K).min() > -1e-10 * K.diagonal().mean(), (
            "a covariance has no negative direction"
        )

    def test_theta_gradient(self) -> None:
        kernel, X, theta = self.kernel, self.inputs(7, 3), self.theta
        G = np.random.default_rng(4).normal(size=(7, 7))
        expected = central(lambda t: float(np.sum(G * self._covariance(t, X))), theta)
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
        for _, vjp in (kernel.gram(theta, X), kernel.cross(theta, X, X)):
            same(vjp(G), vjp(G), "a pull called twice")

    def test_wrong_theta_is_refused(self) -> None:
        for theta in (np.zeros(self.kernel.size + 1), np.full(self.kernel.size, np.nan)):
            try:
                self.kernel.value(theta, self.inputs(2, 0), self.inputs(2, 0))
            except UsageError:
                continue
            raise AssertionError(f"hyperparameters {theta} are not refused")


WIDTH, INSTANTS = 8, 7  # odd numbers on purpose: shapes that are mixed up differ
CHANNELS = (("q", ""), ("qd", ""), ("qdd", ""), ("qd", "tanh"))
CRITERION_COLUMNS = [(c, part, "1", op) for c, op in CHANNELS for part in ("a", "b")]
KERNELS: dict[str, Kernel] = {
    "squared exponential": SquaredExponential(tuple(range(WIDTH))),
    "structured": structured(CRITERION_COLUMNS, ("a",)),
}


class CriterionSuite:
    """Laws of a design criterion. Set `criterion` (a staticmethod)."""

    criterion: ClassVar[Criterion]
    averaged: ClassVar[bool] = False
    """True for a criterion that divides by the number of planned samples."""

    def outputs(self, kernel: str = "structured", unit: float = 1.0) -> list[Output]:
        """Two outputs of a model, of different size."""
        rng, made = np.random.default_rng(0), []
        for size in (unit, 12.0 * unit):
            X = rng.uniform(-1.0, 1.0, (25, WIDTH))
            gp = ExactGP(KERNELS[kernel], KERNELS[kernel].initial(np.ones(WIDTH), size), np.log(0.1 * size))
            posterior = gp.condition(X, rng.standard_normal(25))
            made.append(Output.of(posterior, rng.uniform(-1.0, 1.0, (11, WIDTH))))
        return made

    def planned(self) -> tuple[Array, Array]:
        """Inputs (T, D) and gains (T, 2)."""
        rng = np.random.default_rng(1)
        return rng.uniform(-1.0, 1.0, (INSTANTS, WIDTH)), rng.uniform(-0.9, 0.9, (INSTANTS, 2))

    def value(self, outputs: list[Output], X: Array, gains: Array) -> float:
        return value_of(type(self).criterion, outputs, X, gains)

    def test_gradients(self) -> None:
        for kernel in KERNELS:
            self._check_gradients(self.outputs(kernel), *self.planned())

    def _check_gradients(self, made: list[Output], X: Array, gains: Array) -> None:
        value, in_X, in_gains = evaluate(type(self).criterion, made, X, gains)
        assert abs(value - self.value(made, X, gains)) <= 1e-11 * max(abs(value), 1e-9)
        close(in_X, central(lambda Z: self.value(made, Z, gains), X), 1e-6, "gradient in X")
        close(in_gains, central(lambda g: self.value(made, X, g), gains), 1e-6, "gradient in the gains")

    def test_the_value_is_a_finite_number(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        value = self.value(made, X, gains)
        assert isinstance(value, float), f"the value is a {type(value).__name__}, not a float"
        assert np.isfinite(value), "the value is not a number"

    def test_a_stuck_sample_says_nothing(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        gains[3] = 0.0
        others = np.arange(INSTANTS) != 3
        value, in_X, _ = evaluate(type(self).criterion, made, X, gains)
        without = self.value(made, X[others], gains[others])
        if self.averaged:
            without *= (INSTANTS - 1) / INSTANTS
        assert abs(value - without) <= 1e-9 * max(abs(value), 1e-9), "a sample of weight 0 is used"
        assert np.abs(in_X[3]).max() < 1e-12, "a sample of weight 0 pulls"

    def test_the_sign_of_a_gain_does_not_matter(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        flipped = gains * np.array([1, -1, 1, 1, -1, -1, 1])[:, None]
        value = self.value(made, X, gains)
        assert abs(self.value(made, X, flipped) - value) <= 1e-9 * max(abs(value), 1e-9)

    def test_a_louder_sample_never_says_more(self) -> None:
        made, (X, gains) = self.outputs(), self.planned()
        assert self.value(made, X, 0.7 * gains) < self.value(made, X, gains), (
            "noise does not make it worth less"
        )

    def test_units_of_an_output_do_not_matter(self) -> None:
        X, gains = self.planned()
        values = [self.value(self.outputs("squared exponential", unit), X, gains) for unit in (1.0, 1000.0)]
        assert abs(values[1] - values[0]) <= 1e-7 * max(abs(values[0]), 1e-9), (
            "N m and mN m are designed alike"
        )
