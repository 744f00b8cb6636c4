"""What `init` writes beside each key of campaign.toml; [trajectory] and [data] are explained by the kind."""

from __future__ import annotations

HEAD = """\
# An Étude campaign. Edit it by hand; a key that is left out takes its preset's value, "none" switches off.
# Its hash is stored with every event, so the journal knows which version was in force.
# The robot and its limits are in robot.toml beside this file. Angles are rad, times s.

"""

COMMENTS: dict[str, dict[str, str]] = {
    "model": {
        "rung": '"gp", "linear", "identified", "identified+gp", ...; "auto": what predicts each command best',
        "choose_by": '"squared" or "absolute" held-out error decides',
        "replace": 'a rung replaces another if better by more than "chance", or on "every" held-out motion',
        "process_from": "logs from which processes compete with physics alone",
        "kernel": '"structured", or "ard_se", as the thesis; or a plug-in',
        "sharing": '"separate" processes of the commands, or one kernel "shared" by all',
        "process": '"exact", or another member of docs/models.md, "dictionary_variance" for example',
        "points": "samples each process is conditioned on, at most",
        "inducing": "of twice as many samples all teach, through so many; 0: points alone",
        "basis": "inducing, spectral or basis points, at most, of a process that has them",
        "fit_points": "of these, samples for hyperparameters, at most; of over 4 commands in proportion",
        "fit_spacing_s": "these are at least so many s apart",
        "candidates": "processes that are averaged for each output; docs/models.md says what each is worth",
        "steps": 'of the hyperparameter training; of "minimize" line searches (negative: evaluations)',
        "warm_from": "logs from which training goes on from the last model",
        "warm_steps": "of a training that goes on; 0: as many as steps",
        "method": '"lbfgs", or "minimize": conjugate gradients, as the thesis',
        "starts": "of the training; the best end wins",
        "schedule": 'hyperparameters from log to log: "update", "constant", "reinitialise" or "first"',
        "prior": '"weak" priors on the hyperparameters, or "none"',
        "noise_floor": 'least noise, a part of what floor_of says; or "auto"',
        "floor_of": '"limit" of the command, or "deviation" of what a process learns',
        "stretch_s": "s of what is held out of a single log",
        "calibrate": "widen variances that held-out trajectories show to be too small",
        "student_t": "fit the tails of held-out errors, for the reported density",
    },
    "design": {
        "first": 'the first trajectory: "designed" from the limits alone, or "random"',
        "reference": 'what stands in for tasks: "mixed", moves and slow series; or random ones, "family"',
        "criterion": '"log_ivr", "ivr" (at the tasks), "mean_variance" (thesis 3.2); more: docs/criteria.md',
        "sampler": 'random candidates: "scaled" to the limits, or "uniform" on what is allowed and its edge',
        "candidates": "certified random candidates that are scored",
        "refine": "how many of the best are refined",
        "steps": "iterations of each refinement",
        "points": "planned samples along a trajectory",
        "planned_noise": "planned samples stand for all that will be logged, each with less noise",
        "reference_points": "states per process at which the variance counts",
        "random_share": "part of these taken from what stands in although tasks are given",
        "inducing": "exact processes with more samples are seen through so many; 0: as they are",
        "raw_units": "add variances of different commands as they are, as the thesis",
    },
    "tracking": {
        "margin": 'kept of the limits for tracking errors: "learned" from logs, "assumed", or "none"',
        "position": "assumed before any log where gains are not known: part of each range",
        "velocity": "the same of each velocity limit",
        "most": "part of the way from home to a position limit that a margin may take at most",
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
    "log": {
        "columns": 'names that differ: {"q_shoulder [deg]" = "ActPos1"}; etude inspect --write-mapping',
        "ignored": "headers of columns to leave out",
        "topics": "of logs that hold several; none: those that look like what is needed",
        "rate": "Hz, at which rows of logs without a time column stand; 0: such logs are refused",
    },
}
