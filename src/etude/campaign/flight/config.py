"""FlightConfig: what a flying campaign was told to do; the tables of its campaign.toml."""

from __future__ import annotations

from dataclasses import dataclass, field

from etude.design.flight.config import FlightDesignConfig
from etude.models.flight.config import PRESETS as MODEL
from etude.models.flight.config import FlightModelConfig
from etude.models.flight.preprocess import FLIGHT_DATA, FlightDataConfig
from etude.trajectories.flight.family import FlightFamily

KIND = "vehicle"
"""What campaign.toml says of its kind; nothing for robots of joints."""


@dataclass(frozen=True)
class FlightConfig:
    """Each table is one frozen dataclass of the room that uses it.

    Attributes:
        trajectory: which flights may be asked for.
        data: how a log becomes a data set.
        model: what is learned.
        design: how the next flight is chosen.
    """

    trajectory: FlightFamily = field(default_factory=FlightFamily)
    data: FlightDataConfig = field(default_factory=FlightDataConfig)
    model: FlightModelConfig = field(default_factory=FlightModelConfig)
    design: FlightDesignConfig = field(default_factory=FlightDesignConfig)


FLIGHT_SECTIONS = ("trajectory", "data", "model", "design")
FLIGHT_PRESETS = {
    "default": FlightConfig(FlightFamily(start="moving"), FLIGHT_DATA["default"], MODEL["default"]),
    # thesis 5: hover start, single samples, (h, a, omega, alpha), hyperparameters of the first flight
    "thesis": FlightConfig(
        FlightFamily(start="hover"),
        FLIGHT_DATA["thesis"],
        MODEL["thesis"],
        FlightDesignConfig(criterion="mean_variance"),
    ),
}

FLIGHT_COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": "N of thesis (3.3)",
        "duration": "s of each flight",
        "omega0": 'rad/s, or "none" for one period in the duration',
        "start": '"moving", with the plan\'s velocity, or "hover", at rest, as the thesis',
        "rest": "whether the plan itself starts and ends at rest",
        "free_centre": "whether x and y have a constant term too",
        "centre": "m, constant terms of x and y where they are not free",
    },
    "data": {
        "averaged": "means over each sample interval; false: single samples, as the thesis",
        "lag_s": 's that the motion lags behind the commands; "auto" measures it',
        "first_s": "s cut from the start of a flight",
        "last_s": "s cut from its end",
    },
    "model": {
        "kind": '"gp", "identified", "identified+gp", "nominal+gp", or "auto": best on flights held out',
        "altitude": "whether the altitude is an input",
        "acceleration": '"specific_force", or "kinematic", as the thesis',
        "body_velocity": "whether the velocity is an input; drag depends on it",
        "kernel": '"shared" by the four commands, or "separate"',
        "hyperparameters": '"refit" after each flight, or "first_flight", as the thesis',
        "points": "samples the processes are conditioned on, at most",
        "fit_points": "samples that hyperparameters are fitted to, at most",
        "fit_spacing_s": "these are at least so many s apart",
        "steps": "steps of the hyperparameter training",
        "starts": "starts of the training; the best end wins",
        "prior": '"weak" priors on the hyperparameters, or "none"',
        "noise_floor": "least noise, part of the deviation of what is learned",
        "calibrate": "widen variances that held-out flights show to be too small",
        "student_t": "fit the tails of held-out errors, for the reported density",
    },
    "design": {
        "criterion": '"log_ivr", "ivr" (on intended flights), "info_gain", "mean_variance" (thesis)',
    },
}
