"""Commands that written MJCF files predict, beside the model's physics and the least that their terms reach.

    python tests/arm/inside/measure_mjcf.py three:5,three:6,ur5:1

Of each joint, in parts of the physics' error on the campaign's logs: the file, that with the drives' terms,
and least squares on the terms that each of them has, free of all that a body must obey.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[2]
sys.path[:0] = [str(TESTS / "foreign"), str(TESTS)]

from measure_parameters import LOGS, learned, robot  # noqa: E402
from pinocchio_arm import Array  # noqa: E402

import etude  # noqa: E402
from etude.campaign import Campaign, ingested_samples  # noqa: E402
from etude_arm.identified.consistent_parameters import WhitenedRows, links_of  # noqa: E402
from etude_arm.identified.parameter_fit import FRICTION, OFFSET_TERM, STRIBECK, WAVES, settled  # noqa: E402

ARMATURE_TO_COULOMB = (0, FRICTION.start, FRICTION.start + 1)
"""Of the drive's terms what a joint of an MJCF has."""


def least(campaign: Campaign) -> tuple[Array, Array]:
    """(J,) errors of least squares without and with the drives' terms, command units."""
    spec, samples = campaign.spec, ingested_samples(campaign, range(1, LOGS + 1))
    mean = campaign.kind.physics(spec, campaign.config)["identified"](samples)
    links = links_of(spec)
    evidence = WhitenedRows.of(links, settled(samples, spec, mean))
    first = len(links.nominal)
    own = [*range(first), *(first + k for k in (*ARMATURE_TO_COULOMB, OFFSET_TERM))]
    found = []
    for (rows, y), unit in zip(evidence.rows, evidence.deviation, strict=True):
        for columns in (own, [*own, first + STRIBECK, *range(first + WAVES.start, rows.shape[1])]):
            X = rows[:, columns]
            left = y - X @ np.linalg.lstsq(X, y, rcond=1e-8)[0]
            found.append(unit * np.sqrt(np.mean(left**2)))
    plain, drives = np.reshape(found, (-1, 2)).T
    return plain, drives


def main() -> None:
    print("| robot | joint | file | least | with drives | least |\n|---|---|---|---|---|---|")
    for name in sys.argv[1].split(","):
        arm, text = robot(name)
        with tempfile.TemporaryDirectory() as folder:
            campaign = learned(Path(folder), arm, 0, text)
            played = etude.export(campaign, "mjcf").facts["played"]
            floors = dict(zip(campaign.spec.names, zip(*least(campaign), strict=True), strict=True))
        for joint, physics in played["physics"].items():
            plain, drives = floors[joint]
            errors = played["file"][joint], plain, played["drives"][joint], drives
            print(
                f"| {name} | {joint} | {' | '.join(f'{one / physics:.2f}' for one in errors)} |", flush=True
            )


if __name__ == "__main__":
    main()
