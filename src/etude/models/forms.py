"""Serialization of posteriors and kernels: arrays and JSON, and a registry of their forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from etude import plugins
from etude.models.gp.exact import ExactPosterior, checked_data
from etude.models.gp.kernels import Kernel, Linear, Product, RestNoise, SquaredExponential, Sum
from etude.models.process_abilities import HasKernel, Stored
from etude.protocols import Posterior

if TYPE_CHECKING:  # what is not stored is not loaded
    from etude.models.gp.basis_posterior import BasisPosterior

GROUP = "etude.forms"
Arrays = dict[str, NDArray[Any]]
Metadata = dict[str, Any]
Lookup = Callable[[str], NDArray[Any]]


@dataclass(frozen=True)
class Form:
    """How posteriors, or kernels, of one type are stored: a row of the table of plug-ins, `etude.forms`.

    Attributes:
        arrays: names of its attributes that are arrays, stored as they are; a kernel has none.
        words: names of its numbers and descriptions, stored in full precision.
        make: metadata and a look-up of arrays -> the posterior or the kernel.
    """

    arrays: tuple[str, ...]
    words: tuple[str, ...]
    make: Callable[[Metadata, Lookup], Any]


def _exact(metadata: Metadata, array: Lookup) -> ExactPosterior:
    data = checked_data(array("X"), array("y"))
    return ExactPosterior(
        kernel_of(metadata["kernel"]), array("theta"), float(metadata["noise_variance"]), *data
    )


def _basis(metadata: Metadata, array: Lookup) -> BasisPosterior:
    from etude.models.gp.basis_posterior import BasisPosterior, unpacked

    basis = array("basis")
    try:
        half = unpacked(array("packed"), len(basis))
    except KeyError:  # of an earlier file, which holds the upper half too
        half = np.asfortranarray(array("half"))
    numbers = float(metadata["noise_variance"]), float(metadata["signal_variance"])
    return BasisPosterior(
        kernel_of(metadata["kernel"]), array("theta"), *numbers, basis, array("weights"), half
    )


EXACT = Form(("theta", "X", "y"), ("noise_variance",), _exact)
"""An exact posterior, of a dictionary too, is computed again from its points."""
BASIS = Form(("theta", "basis", "weights", "packed"), ("noise_variance", "signal_variance"), _basis)


def posterior_metadata(posterior: Posterior) -> Metadata:
    """Form, kernel and numbers of a posterior, for JSON. TypeError if its type has no form."""
    name, form = _form_of(posterior)
    metadata: Metadata = {"form": name}
    if isinstance(posterior, HasKernel):
        metadata["kernel"] = kernel_metadata(posterior.kernel)
    return metadata | {word: getattr(posterior, word) for word in form.words}


def posterior_arrays(posterior: Posterior) -> Arrays:
    """The arrays of a posterior by name. TypeError if its type has no form."""
    form = _form_of(posterior)[1]
    return {name: getattr(posterior, name) for name in form.arrays}


def posterior_of(metadata: Metadata, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Posterior:
    """The posterior of its metadata and of the arrays whose names begin with `prefix`.

    Raises:
        ValueError: unknown form or kernel. KeyError: something is missing.
    """
    name = metadata["form"]
    if name not in plugins.names(GROUP):  # a file names forms, it never brings code
        raise ValueError(f"unknown form {name!r} of a posterior")
    posterior: Posterior = plugins.load(GROUP, name).make(metadata, lambda array: arrays[prefix + array])
    return posterior


def _form_of(stored: object) -> tuple[str, Form]:
    if isinstance(stored, Stored) and stored.form in plugins.names(GROUP):
        return stored.form, plugins.load(GROUP, stored.form)
    raise TypeError(f"{type(stored).__name__} has no form on disk yet")


def kernel_metadata(kernel: Kernel) -> Metadata:
    """A kernel for JSON, a plug-in's by its name. TypeError for a type that has no form."""
    from etude.models.gp.plugin_kernel import PluginKernel

    if isinstance(kernel, PluginKernel):
        return {
            "type": "plugin",
            "name": kernel.plugin,
            "columns": [list(column) for column in kernel.columns],
            "commands": list(kernel.commands),
        }
    if isinstance(kernel, Sum | Product):
        return {"type": type(kernel).__name__, "parts": [kernel_metadata(part) for part in kernel.parts]}
    if isinstance(kernel, SquaredExponential):
        return {
            "type": "SquaredExponential",
            "dims": list(kernel.dims),
            "unit": kernel.unit,
            "share": kernel.share,
        }
    if isinstance(kernel, Linear):
        return {"type": "Linear", "dims": list(kernel.dims)}
    if isinstance(kernel, RestNoise):
        return {"type": "RestNoise", "column": kernel.column}
    name, form = _form_of(kernel)
    return {"type": name} | {word: _plain(getattr(kernel, word)) for word in form.words}


def _plain(value: Any) -> Any:
    """For JSON: a description is its fields."""
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


def kernel_of(metadata: Metadata) -> Kernel:
    """The kernel that `kernel_metadata` described.

    Raises:
        ValueError: an unknown type. UsageError: a plug-in that is not there.
    """
    kind = metadata["type"]
    if kind == "plugin":
        from etude.models.gp.plugin_kernel import PluginKernel

        name, columns = metadata["name"], [tuple(column) for column in metadata["columns"]]
        factory = plugins.load("etude.kernels", name)
        return PluginKernel.of(name, factory, columns, tuple(metadata["commands"]))
    if kind in ("Sum", "Product"):
        parts = tuple(kernel_of(part) for part in metadata["parts"])
        return Sum(parts) if kind == "Sum" else Product(parts)
    if kind == "SquaredExponential":
        return SquaredExponential(tuple(metadata["dims"]), bool(metadata["unit"]), float(metadata["share"]))
    if kind == "Linear":
        return Linear(tuple(metadata["dims"]))
    if kind == "RestNoise":
        return RestNoise(int(metadata["column"]))
    if kind in plugins.names(GROUP):
        kernel: Kernel = plugins.load(GROUP, kind).make(metadata, _no_arrays)
        return kernel
    raise ValueError(f"unknown kernel {kind!r}")


def _no_arrays(name: str) -> NDArray[Any]:
    raise ValueError(f"a kernel has no array {name!r}")
