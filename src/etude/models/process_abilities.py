"""Optional abilities of the family's processes, beside `etude.protocols.Posterior`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from etude.protocols import Candidate, Posterior
from etude.types import Array, Code, Index

if TYPE_CHECKING:
    from etude.models.gp.kernels import Kernel


@dataclass(frozen=True, eq=False)
class EnsembleMember(Candidate):
    """A candidate with its place among those of its structure.

    Attributes:
        name: "default", or one of `ensemble.CANDIDATES`.
        share: (m,) weight within the structure, whatever structure a command has; None: 1, there is no other.
        error: (m,) mean absolute error on motion held out, command units; None if it was not stored.
    """

    name: str = "default"
    share: Array | None = None
    error: Array | None = None


def share_of(candidate: Candidate) -> Array:
    """(m,) weight of a candidate within its structure."""
    share = candidate.share if isinstance(candidate, EnsembleMember) else None
    return np.ones(len(candidate.commands)) if share is None else share


def name_of(candidate: Candidate) -> str:
    """Its place among those of its structure."""
    return candidate.name if isinstance(candidate, EnsembleMember) else "default"


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
        """Posteriors of one type with the same key are evaluated in one call."""
        ...

    def onnx_moments(self, graph: Any, x: str, own: Sequence[Any], variance: bool) -> tuple[str, str]:
        """Means and latent variances (n, m) of the posteriors `own` at x (n, D); "" if not asked for.

        graph: a `deploy.targets.onnx.model_graph.Graph`.
        """
        ...


@runtime_checkable
class HasInputs(Protocol):
    """Capability of a `protocols.Process`: where it was conditioned on data, so that it says how well it
    knows there.
    """

    @property
    def conditioned_on(self) -> Array | None:
        """(k, D) inputs; None if it stores none."""
        ...


@runtime_checkable
class SupportsMeans(Protocol):
    """A process or a posterior that gives means alone, without the price of their variances."""

    def mean(self, X: Array) -> Array: ...


@runtime_checkable
class SupportsBound(Protocol):
    """A process or a posterior: means, and latent variances of at least those of `predict`, for less."""

    def at_most(self, X: Array) -> tuple[Array, Array]: ...


@runtime_checkable
class SupportsRestNoise(Protocol):
    """A process whose latent variance holds noise at rest: of each command pairs as of `gp.kernels.rests`."""

    @property
    def rests(self) -> Sequence[Sequence[tuple[int, float]]]: ...


@runtime_checkable
class SupportsSamples(Protocol):
    """A posterior that keeps the inputs (n, D) of its samples."""

    @property
    def X(self) -> Array: ...


@runtime_checkable
class SupportsSharedFactor(Protocol):
    """A posterior with a factor of its covariance: those that share it are one latent function to designs."""

    @property
    def L(self) -> Array: ...


@runtime_checkable
class SupportsFactors(Protocol):
    """A posterior whose covariances at inputs X (T, D) share factors, a `criteria.Batch`."""

    def factors(self, X: Array) -> Any: ...


@runtime_checkable
class SupportsSeparate(Protocol):
    """A process with a posterior of each command alone, which may go on learning."""

    @property
    def own(self) -> tuple[Posterior, ...]: ...


@runtime_checkable
class SupportsPoint(Protocol):
    """A process with a fast function of one input, x (D,) -> means (m,): for a controller's tick."""

    def point(self) -> Callable[[Array], Array]: ...


@runtime_checkable
class SupportsGuide(Protocol):
    """A posterior without covariances, and the one that designs see in its place."""

    @property
    def guide(self) -> Posterior: ...


@runtime_checkable
class SupportsClosedForm(Protocol):
    """How a member is conditioned, if it is held out in closed form.

    X (k, D): inputs of samples that are in the folds with these numbers. Y (n, m): all outputs. Means and
    variances with noise (k, m).
    """

    def held_out(self, X: Array, numbers: Index, Y: Array) -> tuple[Array, Array]: ...
