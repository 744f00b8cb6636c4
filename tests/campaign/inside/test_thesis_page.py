"""The configurations of docs/thesis_settings.md are configurations, and its first one is the preset."""

from __future__ import annotations

import re
from pathlib import Path

from etude import plugins
from etude.campaign import CampaignConfig, preset_config
from etude.campaign.record.config_file import parse_config

PAGE = (Path(__file__).parents[3] / "docs" / "thesis_settings.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def parsed(text: str) -> CampaignConfig:
    """A part of a campaign.toml of an arm."""
    return parse_config(f'kind = "arm"\n{text}'.encode(), "docs/thesis_settings.md").config


def preset(name: str) -> CampaignConfig:
    return preset_config(plugins.load("etude.robots", "arm"), name)


def test_the_first_block_spells_out_the_preset() -> None:
    assert parsed(BLOCKS[0]) == preset("thesis")
    assert parsed(BLOCKS[0].replace('"thesis"', '"default"', 1)).model.points == 500


def test_the_named_systems_can_be_configured() -> None:
    random, spectrum, full = map(parsed, BLOCKS[1:])
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
            parsed(f'preset = "thesis"\n[model]\n{key} = {value}\n')
