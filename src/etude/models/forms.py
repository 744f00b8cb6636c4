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
Words = dict[str, Any]
Lookup = Callable[[str], NDArray[Any]]


@dataclass(frozen=True)
class Form:
    """How posteriors, or kernels, of one type are stored: a row of the table of plug-ins, `etude.forms`.

    Attributes:
        arrays: names of its attributes that are arrays, stored as they are; a kernel has none.
        words: names of its numbers and descriptions, stored in full precision.
        make: words and a look-up of arrays -> the posterior or the kernel.
    """

    arrays: tuple[str, ...]
    words: tuple[str, ...]
    make: Callable[[Words, Lookup], Any]


def _exact(words: Words, array: Lookup) -> ExactPosterior:
    known = checked_data(array("X"), array("y"))
    return ExactPosterior(kernel_of(words["kernel"]), array("theta"), float(words["noise_variance"]), *known)


def _basis(words: Words, array: Lookup) -> BasisPosterior:
    from etude.models.gp.basis_posterior import BasisPosterior, unpacked

    basis = array("basis")
    try:
        half = unpacked(array("packed"), len(basis))
    except KeyError:  # of an earlier file, which holds the upper half too
        half = np.asfortranarray(array("half"))
    numbers = float(words["noise_variance"]), float(words["signal_variance"])
    return BasisPosterior(kernel_of(words["kernel"]), array("theta"), *numbers, basis, array("weights"), half)


EXACT = Form(("theta", "X", "y"), ("noise_variance",), _exact)
"""An exact posterior, of a dictionary too, is computed again from its points."""
BASIS = Form(("theta", "basis", "weights", "packed"), ("noise_variance", "signal_variance"), _basis)


def posterior_words(posterior: Posterior) -> Words:
    """Form, kernel and numbers of a posterior, for JSON. TypeError if its type has no form."""
    name, form = _form_of(posterior)
    words: Words = {"form": name}
    if isinstance(posterior, HasKernel):
        words["kernel"] = kernel_words(posterior.kernel)
    return words | {word: getattr(posterior, word) for word in form.words}


def posterior_arrays(posterior: Posterior) -> Arrays:
    """The arrays of a posterior by name. TypeError if its type has no form."""
    form = _form_of(posterior)[1]
    return {name: getattr(posterior, name) for name in form.arrays}


def posterior_of(words: Words, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Posterior:
    """The posterior of its words and of the arrays whose names begin with `prefix`.

    Raises:
        ValueError: unknown form or kernel. KeyError: something is missing.
    """
    name = words["form"]
    if name not in plugins.names(GROUP):  # a file names forms, it never brings code
        raise ValueError(f"unknown form {name!r} of a posterior")
    found: Posterior = plugins.load(GROUP, name).make(words, lambda array: arrays[prefix + array])
    return found


def _form_of(stored: object) -> tuple[str, Form]:
    if isinstance(stored, Stored) and stored.form in plugins.names(GROUP):
        return stored.form, plugins.load(GROUP, stored.form)
    raise TypeError(f"{type(stored).__name__} has no form on disk yet")


def kernel_words(kernel: Kernel) -> Words:
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
        return {"type": type(kernel).__name__, "parts": [kernel_words(part) for part in kernel.parts]}
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


def kernel_of(words: Words) -> Kernel:
    """The kernel that `kernel_words` described.

    Raises:
        ValueError: an unknown type. UsageError: a plug-in that is not there.
    """
    kind = words["type"]
    if kind == "plugin":
        from etude.models.gp.plugin_kernel import PluginKernel

        name, columns = words["name"], [tuple(column) for column in words["columns"]]
        factory = plugins.load("etude.kernels", name)
        return PluginKernel.of(name, factory, columns, tuple(words["commands"]))
    if kind in ("Sum", "Product"):
        parts = tuple(kernel_of(part) for part in words["parts"])
        return Sum(parts) if kind == "Sum" else Product(parts)
    if kind == "SquaredExponential":
        return SquaredExponential(tuple(words["dims"]), bool(words["unit"]), float(words["share"]))
    if kind == "Linear":
        return Linear(tuple(words["dims"]))
    if kind == "RestNoise":
        return RestNoise(int(words["column"]))
    if kind in plugins.names(GROUP):
        found: Kernel = plugins.load(GROUP, kind).make(words, _no_arrays)
        return found
    raise ValueError(f"unknown kernel {kind!r}")


def _no_arrays(name: str) -> NDArray[Any]:
    raise ValueError(f"a kernel has no array {name!r}")
