"""Posteriors and kernels as arrays beside a few words, and a registry of the forms a posterior can have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from etude import plugins
from etude.contracts import Posterior
from etude.models.gp.exact import ExactPosterior, checked_data
from etude.models.gp.kernels import Kernel, Linear, Product, SquaredExponential, Sum
from etude.models.gp.rest import RestNoise

if TYPE_CHECKING:  # what is not stored is not loaded
    from etude.models.gp.basis_posterior import BasisPosterior
    from etude.models.gp.local_posterior import LocalPosterior
    from etude.models.gp.spectral_posterior import SparseSpectrumPosterior
    from etude.models.lwpr.posterior import LWPRPosterior

Arrays = dict[str, NDArray[Any]]
Words = dict[str, Any]
Lookup = Callable[[str], NDArray[Any]]


@dataclass(frozen=True)
class Form:
    """How posteriors of one type are stored.

    Attributes:
        type: name of the posteriors' type, with its module below `etude.models`.
        arrays: names of its attributes that are arrays, stored as they are.
        words: names of its numbers, stored in full precision.
        make: words and a look-up of arrays -> the posterior.
    """

    type: str
    arrays: tuple[str, ...]
    words: tuple[str, ...]
    make: Callable[[Words, Lookup], Posterior]


def _exact(words: Words, array: Lookup) -> ExactPosterior:
    known = checked_data(array("X"), array("y"))
    return ExactPosterior(kernel_of(words["kernel"]), array("theta"), float(words["noise_variance"]), *known)


def _basis(words: Words, array: Lookup) -> BasisPosterior:
    from etude.models.gp.basis_posterior import BasisPosterior

    return BasisPosterior(
        kernel_of(words["kernel"]),
        array("theta"),
        float(words["noise_variance"]),
        float(words["signal_variance"]),
        array("basis"),
        array("weights"),
        np.asfortranarray(array("half")),
    )


def _spectrum(words: Words, array: Lookup) -> SparseSpectrumPosterior:
    from etude.models.gp.spectral_features import SpectralFeatures
    from etude.models.gp.spectral_posterior import SparseSpectrumPosterior

    return SparseSpectrumPosterior(
        SpectralFeatures(array("frequencies")),
        float(words["signal_variance"]),
        float(words["noise_variance"]),
        array("weights"),
        np.asfortranarray(array("L")),
        array("X"),
        array("y"),
        array("theta"),
    )


def _local(words: Words, array: Lookup) -> LocalPosterior:
    from etude.models.gp.local_posterior import local_posterior_given

    return local_posterior_given(
        kernel_of(words["kernel"]),
        array("theta"),
        float(words["noise_variance"]),
        array("centres"),
        array("lengths"),
        int(words["nearest"]),
        (array("X"), array("y"), array("counts")),
    )


LWPR_ARRAYS = ("c", "x0", "F", "level", "slope", "spread", "residual")


def _lwpr(words: Words, array: Lookup) -> LWPRPosterior:
    from etude.models.lwpr.posterior import LWPRPosterior

    return LWPRPosterior(
        float(words["noise_variance"]),
        float(words["signal_variance"]),
        *(array(name) for name in LWPR_ARRAYS),
    )


FORMS = {
    "exact": Form("gp.exact:ExactPosterior", ("theta", "X", "y"), ("noise_variance",), _exact),
    "basis": Form(
        "gp.basis_posterior:BasisPosterior",
        ("theta", "basis", "weights", "half"),
        ("noise_variance", "signal_variance"),
        _basis,
    ),
    "spectrum": Form(
        "gp.spectral_posterior:SparseSpectrumPosterior",
        ("weights", "L", "X", "y", "theta"),
        ("noise_variance", "signal_variance"),
        _spectrum,
    ),
    "local": Form(
        "gp.local_posterior:LocalPosterior",
        ("theta", "centres", "lengths", "X", "y", "counts"),
        ("noise_variance", "nearest"),
        _local,
    ),
    "lwpr": Form("lwpr.posterior:LWPRPosterior", LWPR_ARRAYS, ("noise_variance", "signal_variance"), _lwpr),
}
"""The forms by name; an exact posterior, of a dictionary too, is computed again from its points."""


def posterior_words(posterior: Posterior) -> Words:
    """Form, kernel and numbers of a posterior, for JSON. TypeError if its type has no form."""
    name, form = _form_of(posterior)
    kernel = getattr(posterior, "kernel", None)
    words: Words = {"form": name} if kernel is None else {"form": name, "kernel": kernel_words(kernel)}
    return words | {word: getattr(posterior, word) for word in form.words}


def posterior_arrays(posterior: Posterior) -> Arrays:
    """The arrays of a posterior by name. TypeError if its type has no form."""
    name, form = _form_of(posterior)
    arrays: Arrays = {name: getattr(posterior, name) for name in form.arrays}
    if name == "spectrum":
        arrays["frequencies"] = cast("SparseSpectrumPosterior", posterior).features.frequencies
    return arrays


def posterior_of(words: Words, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Posterior:
    """The posterior of its words and of the arrays whose names begin with `prefix`.

    Raises:
        ValueError: unknown form or kernel. KeyError: something is missing.
    """
    name = words["form"]
    if name not in FORMS:
        raise ValueError(f"unknown form {name!r} of a posterior")
    return FORMS[name].make(words, lambda array: arrays[prefix + array])


def _form_of(posterior: Posterior) -> tuple[str, Form]:
    own = f"{type(posterior).__module__}:{type(posterior).__name__}"
    for name, form in FORMS.items():
        if own == f"etude.models.{form.type}":
            return name, form
    raise TypeError(f"a posterior of type {type(posterior).__name__} has no form on disk yet")


def kernel_words(kernel: Kernel) -> Words:
    """A kernel for JSON, a plug-in's by its name. TypeError for a type that has no form."""
    from etude.models.gp.plugin_kernel import PluginKernel
    from etude.models.lagrangian.kernel import Lagrangian

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
    if isinstance(kernel, Lagrangian):
        return {"type": "Lagrangian", "joints": asdict(kernel.joints), "own": kernel.own}
    raise TypeError(f"a kernel of type {type(kernel).__name__} has no form on disk yet")


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
    if kind == "Lagrangian":
        from etude.models.lagrangian.joints import Joints
        from etude.models.lagrangian.kernel import Lagrangian

        joints = {name: tuple(values) for name, values in words["joints"].items()}
        return Lagrangian(Joints(**joints), int(words["own"]))
    raise ValueError(f"unknown kernel {kind!r}")
