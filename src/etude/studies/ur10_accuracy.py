"""How well one real log can be predicted: the UR10 of `examples/`, in a package as in a checkout.

Commands are low-pass filtered with the motion, held-out ones too, as in every campaign. The held-out blocks
last some 1.4 s and lie between training blocks: this is interpolation within one motion.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from etude.logs.read import read_log
from etude.models.blocks import linear_regression, split_blocks
from etude.models.calibration import score
from etude.models.inverse_dynamics import train_model
from etude.models.ladder import train_ladder
from etude.models.model_config import ModelConfig
from etude.models.preprocess import build_dataset, preset
from etude.robots.toml_file import load_robot
from etude.studies.rows import Row

LOG = "ur10_exciting.csv"
EXAMPLE = Path("examples") / "ur10"
PLACES = (Path(__file__).parents[1] / EXAMPLE, Path(__file__).parents[3] / EXAMPLE)
FOLDER = next((place for place in PLACES if (place / LOG).is_file()), PLACES[0])


def ur10_rows(rng: np.random.Generator) -> list[Row]:
    """`nmse_ur10` of the default process without rigid body, and `nmse_ur10_ladder` of the default choice.

    Both are means over the joints, on samples where that joint moves. No row, and a message on stderr,
    where the log is not there.
    """
    if not (FOLDER / LOG).is_file():
        _say(f"nmse_ur10 left out: there is no {FOLDER / LOG}; install etude again, or run in a checkout.")
        return []
    spec = load_robot(FOLDER / "ur10.toml")
    dataset = build_dataset(read_log(FOLDER / LOG, spec), spec, preset("default"))
    train, test = split_blocks(dataset)
    moving = ~test.stuck
    linear = score(test.tau, linear_regression(train, test), None, moving).nmse
    models = {
        "nmse_ur10": train_model(train, spec, ModelConfig(kind="gp"), rng),
        "nmse_ur10_ladder": train_ladder(train, spec, ModelConfig(), rng).model,
    }
    rows = []
    for metric, model in models.items():
        found = score(test.tau, *model.predict(test.q, test.qd, test.qdd), moving)
        named = f"linear regression; kind = {model.kind}"
        rows.append(Row(metric, float(np.nanmean(found.nmse)), "1", named, float(np.nanmean(linear))))
    return rows


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, highlight=False)
