"""What `init` writes beside the keys of an arm's own tables in campaign.toml."""

from __future__ import annotations

COMMENTS: dict[str, dict[str, str]] = {
    "trajectory": {
        "harmonics": 'N of thesis (3.5), 2 or more (1 is possible with rest = "ramp")',
        "duration": "s of each recording, links between its segments apart",
        "omega0": 'rad/s: a number, a range [low, high], or "none": segments of a period that suits it',
        "rest": 'how it starts and ends at rest: "nullspace" or "ramp"',
        "ramp": 's of each phase ramp, for rest = "ramp"',
    },
    "data": {
        "inputs": '"measured" positions, differentiated; or "desired" motion, as the thesis',
        "cutoff_hz": 'zero-phase low-pass: Hz, "auto", or "none"',
        "rate_hz": "samples kept per second of log",
        "least_samples": "of a short log more are kept per second, until there are this many",
        "stick_fraction": "a joint slower than this part of its top speed counts as stuck; 0: no mask",
        "reversal": "periods of the cutoff around a fast reversal that teach nothing; 0: all teach",
        "plenty": "samples a joint has to have left for that",
        "trim_s": 's cut from both ends of a log; "auto" is one period of the cutoff',
        "friction_fraction": "width of the friction input, fraction of the velocity limit; 0 for none",
        "presliding": "rad over which friction turns round (m: a tenth): it is remembered; 0: it is not",
        "offset": 'where thinning begins: "spread", elsewhere in each log, or at the "first" sample',
    },
}
