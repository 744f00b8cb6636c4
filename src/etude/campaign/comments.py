"""What `init` writes beside each key of campaign.toml."""

from __future__ import annotations

HEAD = """\
# An Étude campaign. Edit it by hand; a key that is left out takes its preset's value, "none" switches off.
# Its hash is stored with every event, so the journal knows which version was in force.
# The robot and its limits are in robot.toml beside this file. Angles are rad, times s.

"""

COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": 'N of thesis (3.5), 2 or more (1 is possible with rest = "ramp")',
        "duration": "s of each trajectory",
        "omega0": 'rad/s: a number, a range [low, high], or "none" for one period in the duration',
        "rest": 'how it starts and ends at rest: "nullspace" or "ramp"',
        "ramp": 's of each phase ramp, for rest = "ramp"',
    },
    "data": {
        "inputs": '"measured" positions, differentiated; or "desired" motion, as the thesis',
        "cutoff_hz": 'zero-phase low-pass: Hz, "auto", or "none"',
        "rate_hz": "samples kept per second of log",
        "least_samples": "of a short log more are kept per second, until there are this many",
        "stick_fraction": "a joint slower than this part of its top speed counts as stuck; 0: no mask",
        "trim_s": 's cut from both ends of a log; "auto" is one period of the cutoff',
    },
    "model": {
        "kind": '"gp", "identified", "identified+gp", or "auto": whichever predicts the newest log best',
        "kernel": '"structured", or "ard_se", as the thesis',
        "process": '"exact", or another member of docs/models.md, "dictionary_variance" for example',
        "points": "samples each output is conditioned on, at most",
        "basis": "inducing, spectral or basis points, at most, of a process that has them",
        "fit_points": "of these, samples that hyperparameters are fitted to, at most",
        "fit_spacing_s": "these are at least so many s apart",
        "steps": 'of the hyperparameter training; of "minimize" line searches (negative: evaluations)',
        "method": '"lbfgs", or "minimize": conjugate gradients, as the thesis',
        "schedule": 'hyperparameters from log to log: "update", "constant" or "reinitialise" (thesis 6.1)',
        "prior": '"weak" priors on the hyperparameters, or "none"',
        "noise_floor": 'least noise, fraction of the command limit; or "auto"',
        "friction_fraction": "width of the friction feature, fraction of the velocity limit; 0 for none",
        "calibrate": "widen variances that held-out trajectories show to be too small",
        "guard": "outputs that linear regression predicts better on held-out trajectories fall back to it",
    },
    "design": {
        "criterion": '"log_ivr", "ivr" (at the tasks), "mean_variance" (thesis 3.2); more: docs/criteria.md',
        "candidates": "certified random candidates that are scored",
        "refine": "how many of the best are refined",
        "steps": "iterations of each refinement",
        "points": "planned samples along a trajectory",
        "reference_points": "states per output at which the variance counts",
        "random_share": "part of these taken from random motions although tasks are given",
        "raw_units": "add variances of different joints as they are, as the thesis",
    },
    "stop": {
        "command_tolerance": "good enough: forecast error as a fraction of the command limit; 0: off",
        "noise_fraction": "stop when the variance left is below this fraction of the noise; 0: off",
        "gain_per_minute": "stop when less of the variance left goes per robot minute; 0: off",
        "setup_s": "s of robot time each trajectory costs besides its duration",
        "budget_trajectories": "logs; 0 for no limit",
        "budget_minutes": "minutes of recorded motion; 0 for no limit",
        "consecutive": "logs in a row that must agree before a rule stops the campaign",
    },
}
