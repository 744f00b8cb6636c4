"""campaign.toml survives its editors: what it can say is read back, what it cannot is refused by name."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest

from etude.campaign.comments import COMMENTS
from etude.campaign.config import SECTIONS, CampaignConfig
from etude.campaign.config_file import config_text, load_config, parse_config
from etude.campaign.presets import NAMES, preset
from etude.errors import UsageError
from etude.trajectories.family import TrajectoryFamily


def parse(text: str) -> CampaignConfig:
    return parse_config(text.encode(), "lab/campaign.toml")


@pytest.mark.parametrize("name", NAMES)
def test_what_init_writes_reads_back(name: str) -> None:
    config = replace(preset(name), seed=11)
    assert parse(config_text(config)) == config


def test_every_key_is_explained() -> None:
    for section in SECTIONS:
        keys = [field.name for field in fields(getattr(preset("default"), section))]
        assert list(COMMENTS[section]) == keys


def test_keys_left_out_come_from_the_preset() -> None:
    assert parse("") == preset("default")
    config = parse('preset = "thesis"\n[trajectory]\nharmonics = 3\n')
    assert config.trajectory == replace(preset("thesis").trajectory, harmonics=3)
    assert config.data == preset("thesis").data


@pytest.mark.parametrize(
    ("value", "omega0"), [('"none"', None), ("0.5", 0.5), ("[0.1, 0.5]", (0.1, 0.5)), ("1", 1)]
)
def test_unions_are_read(value: str, omega0: object) -> None:
    config = parse(f'[trajectory]\nrest = "ramp"\nomega0 = {value}\n')
    assert config.trajectory == TrajectoryFamily(rest="ramp", omega0=omega0)  # type: ignore[arg-type]


def test_none_is_a_word_where_it_is_one() -> None:
    assert parse('[data]\ncutoff_hz = "none"\n').data.cutoff_hz == "none"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[trajectory]\nharmonic = 5",
            r"unknown key 'harmonic' \[lab/campaign.toml \[trajectory\]\].*mean harmonics",
        ),
        ("[trajektory]\nharmonics = 5", r"unknown key 'trajektory'.*Did you mean trajectory"),
        ("colour = 3", r"unknown key 'colour'.*Valid keys: kind, preset, seed, trajectory, data"),
        (
            '[trajectory]\nharmonics = "five"',
            r"harmonics = \"five\" is not possible.*\[trajectory\] harmonics",
        ),
        ("[trajectory]\nharmonics = 2.5", "harmonics = 2.5 is not possible"),
        ("[trajectory]\nharmonics = true", "harmonics = true is not possible"),
        ("[trajectory]\nharmonics = -1", r"harmonics >= 1.*\[trajectory\]"),
        ('[trajectory]\nrest = "ramp"\nomega0 = [0.5, 0.1]', "0.5..0.1"),
        ("[trajectory]\nduration = nan", "duration|omega0"),
        ("[trajectory]\nduration = inf", "duration|omega0"),
        ('[trajectory]\nrest = "sleep"', "is not possible"),
        ("[stop]\nconsecutive = 0", "consecutive must be 1 or more"),
        ("[stop]\nbudget_minutes = -1.0", "budget_minutes"),
        ("[stop]\nsetup_s = nan", "setup_s"),
        ('[design]\ncriterion = "luck"', "luck"),
        ("[model]\npoints = 0", "points"),
        ("[data]\nrate_hz = 0.0", "rate_hz"),
        ("trajectory = 3", "expected a table"),
        ('preset = "best"', "unknown preset 'best'.*default, thesis"),
        ("seed = -1", "seed = -1"),
        ('seed = "x"', "seed = 'x'"),
        ("seed = true", "seed = True"),
        ("[trajectory\nharmonics = 5", "not TOML"),
        ("\x00", "not TOML"),
        ("seed = 1\nseed = 2", "not TOML"),
    ],
)
def test_impossible_edits_name_file_and_key(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse(text)
    assert "lab/campaign.toml" in caught.value.where


def test_bytes_that_are_no_text_are_refused() -> None:
    with pytest.raises(UsageError, match="not TOML"):
        parse_config(b"\xff\xfe", "lab/campaign.toml")


def test_no_campaign_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no campaign here.*etude init"):
        load_config(tmp_path)
