"""What processes of the family may offer beside `etude.protocols.Posterior`."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from etude.protocols import Candidate, Posterior
from etude.types import Array, Code

if TYPE_CHECKING:
    from etude.models.gp.kernels import Kernel


@dataclass(frozen=True, eq=False)
class EnsembleMember(Candidate):
    """A candidate with its place among those of its rung.

    Attributes:
        name: "default", or one of `ensemble.CANDIDATES`.
        share: (m,) weight within the rung, whatever rung a command has; None: 1, there is no other.
        error: (m,) mean absolute error on motion held out, command units; None where nobody kept it.
    """

    name: str = "default"
    share: Array | None = None
    error: Array | None = None


def share_of(candidate: Candidate) -> Array:
    """(m,) weight of a candidate within its rung."""
    share = getattr(candidate, "share", None)
    return np.ones(len(candidate.commands)) if share is None else share


@runtime_checkable
class HasKernel(Protocol):
    """A posterior with a covariance function, so its hyperparameters can be compared or start a training."""

    @property
    def kernel(self) -> Kernel: ...

    @property
    def theta(self) -> Array:
        """(P,) log hyperparameters of `kernel`."""
        ...


@runtime_checkable
class Stored(Protocol):
    """A posterior or a kernel that a file can hold."""

    form: ClassVar[str]
    """Name of its row in the table of plug-ins, `etude.forms`: how it is stored."""


@runtime_checkable
class SupportsFirstUse(Protocol):
    """A member, or a kernel's factory, whose first use on a machine takes a while."""

    def first_use(self) -> str:
        """A sentence for who waits, if it is still to come; else ""."""
        ...


@runtime_checkable
class SupportsC(Protocol):
    """A posterior of one output that writes its own C99."""

    def c(self, name: str) -> Code:
        """void name(const real *x, real *mean, real *variance), as the other processes' functions."""
        ...


@runtime_checkable
class SupportsOnnxMoments(Protocol):
    """A posterior of one output that has its own operators in an ONNX graph."""

    @property
    def columns_read(self) -> Collection[int]:
        """Columns of the inputs that it looks at."""
        ...

    @property
    def alike(self) -> Hashable:
        """Posteriors of one type that are equal in this are asked in one call."""
        ...

    def onnx_moments(self, graph: Any, x: str, own: Sequence[Any], variance: bool) -> tuple[str, str]:
        """Means and latent variances (n, m) of the posteriors `own` at x (n, D); "" if not asked for.

        graph: a `deploy.onnx.model_graph.Graph`.
        """
        ...


@runtime_checkable
class HasInputs(Protocol):
    """Capability of a `protocols.Process`: where it was conditioned on data, so that it says how well it
    knows there.
    """

    @property
    def conditioned_on(self) -> Array | None:
        """(k, D) inputs; None where it kept none."""
        ...


class GaussianProcess(Protocol):
    """A Gaussian process with its hyperparameters, before it has seen data."""

    def condition(self, X: Array, y: Array) -> Posterior:
        """The posterior given inputs X (n, D) and outputs y (n,)."""
        ...

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log p(y | X) and its gradient with respect to `theta`, the log hyperparameters (P,)."""
        ...
