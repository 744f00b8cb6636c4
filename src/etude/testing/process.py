"""What every member of the model family owes: FitData in, a Process out."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from etude.models.config import ModelConfig
from etude.models.gp.kernels import SquaredExponential
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
        own = np.flatnonzero(data.group == 1)
        mean, variance = process.held_out(own)
        assert mean.shape == variance.shape == (len(own), self.commands), (
            "one prediction for each sample left out"
        )
        spoiled = data.Y.copy()
        spoiled[own] += 100.0
        again, _ = process.held_out(own, spoiled)
        close(again, mean, 1e-6, "what is said of a group when only that group's outputs change")
        assert np.all(variance > 0.0), "held-out variances include the noise"

    def test_restored_from_its_arrays_it_is_the_same(self) -> None:
        process, Z = self.fitted(), self.elsewhere()
        restored: Process = type(self).member.restore(process.arrays())
        for name, found, wanted in zip(
            ("mean", "variance"), restored.predict(Z), process.predict(Z), strict=True
        ):
            same(found, wanted, f"{name} after storing")

    def test_latents_have_their_gradients(self) -> None:
        if not self.covariances:
            return
        Z = self.elsewhere(4)
        G, g = np.random.default_rng(2).standard_normal((4, 5)), np.linspace(0.5, 2.0, 4)
        R = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 3))
        covered: list[int] = []
        for posterior, own in self.fitted().latents():
            covered += own
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
        own = np.arange(30)
        assert large.held_out(own)[1].mean() > small.held_out(own)[1].mean(), "the noise floor is not heeded"
