"""The configurations of docs/thesis.md are configurations, and its first one is the preset."""

from __future__ import annotations

import re
from pathlib import Path

from etude.campaign.config_file import parse_config
from etude.campaign.presets import preset

PAGE = (Path(__file__).parents[2] / "docs" / "thesis.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_the_first_block_spells_out_the_preset() -> None:
    config = parse_config(BLOCKS[0].encode(), "docs/thesis.md")
    assert config == preset("thesis")
    assert parse_config(BLOCKS[0].replace('"thesis"', '"default"', 1).encode(), "").model.points == 500


def test_the_named_systems_can_be_configured() -> None:
    random, spectrum, full = (parse_config(block.encode(), "docs/thesis.md") for block in BLOCKS[1:])
    assert (random.design.candidates, random.design.refine) == (1, 0)
    assert random.model == preset("thesis").model
    assert (spectrum.model.process, spectrum.model.basis, spectrum.model.steps) == ("ssgp_learned", 200, 5)
    assert spectrum.model.schedule == "reinitialise"
    assert (full.model.process, full.model.points, full.model.steps) == ("exact", 3000, 25)


def test_every_word_in_its_table_is_one_that_the_configuration_knows() -> None:
    choices = re.findall(r"`(schedule|process|steps) = (\S+)`((?:, `[^`]+`)*)", PAGE)
    assert {key for key, _, _ in choices} == {"schedule", "process", "steps"}
    for key, first, others in choices:
        for value in (first, *re.findall(r"`([^`]+)`", others)):
            parse_config(f'preset = "thesis"\n[model]\n{key} = {value}\n'.encode(), "docs/thesis.md")
