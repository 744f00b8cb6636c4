"""Runs of neither arm nor flights by name: kernels, timings, traces of single runs, related controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from etude_studies.spec import Spec
from etude_studies.thesis.arm_runs import baseline_spec
from etude_studies.thesis.arm_traces import TRACED, trace_spec
from etude_studies.thesis.ilc_runs import adaptive_spec, repeated_spec
from etude_studies.thesis.reach_runs import reach_spec

TIMINGS = 16
"""Repeats of the timings; fewer cannot pass the correction for how many claims are asked."""


def regressor_spec(seed: int, *methods: str) -> Spec:
    """M1 of a seed, or these methods alone, with the motions of A6."""
    draws = Spec("etude_studies.thesis.arm_motions:draws", {"motions": "scaled"}, seed)
    settings = {"methods": list(methods)} if methods else {}
    return Spec("etude_studies.thesis.regressor_runs:on_the_arm", settings, seed, [draws])


def _network_spec(seed: int) -> Spec:
    return regressor_spec(seed, "lagrangian_network")


def _plain(function: str, seed: int) -> Spec:
    return Spec(f"etude_studies.thesis.{function}", {}, seed)


SMALL_RUNS: Mapping[str, tuple[str, int, Callable[[int], Spec]]] = {
    "K1": (
        "spectral points for a kernel, a seed a draw",
        20,
        partial(_plain, "kernel_figure:run"),
    ),
    "T1": ("timings by the number of points, a seed a repeat", TIMINGS, partial(_plain, "costs:run")),
    "Y1": ("iterative learning control on the test itself", 20, repeated_spec),
    "Y6": ("adaptive control: Slotine and Li, Craig", 20, adaptive_spec),
    "R1": ("robot seconds until an error is reached, by method", 20, reach_spec),
    "O1": ("learning on line, also after the arm has changed", 20, partial(_plain, "other_runs:on_line")),
    "L1": ("voltages of a process in the quadrotor's loop", 20, partial(_plain, "other_runs:in_the_loop")),
    "Y5": (
        "dictionaries, sparse spectra and full GPR on the quadrotor's flights",
        20,
        partial(_plain, "flight_members:run"),
    ),
    "M1": ("methods that the thesis does not have, on A6's samples", 20, regressor_spec),
    "M2": (
        "methods that the thesis does not have, on Y5's flights",
        20,
        partial(_plain, "regressor_runs:on_flights"),
    ),
    "M3": ("a deep Lagrangian network on A6's samples", 20, _network_spec),
    "W0": (
        "feedback alone on an arm on a wheeled base",
        20,
        partial(baseline_spec, "pd", robot="mobile_arm"),
    ),
    "P2t": ("a path and a thrust command of P2 over time", 1, partial(_plain, "flight_trace_run:run")),
    **{name: (f"{run} over time", 20, partial(trace_spec, name)) for name, (run, _) in TRACED.items()},
}
"""What each is, seeds, spec of a seed."""
