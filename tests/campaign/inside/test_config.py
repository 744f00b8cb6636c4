"""campaign.toml survives its editors: what it can say is read back, what it cannot is refused by name."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest

from etude import plugins
from etude.campaign import (
    CampaignConfig,
    config_text,
    create_campaign,
    load_config,
    open_campaign,
    preset_config,
)
from etude.campaign.record.config import SECTIONS
from etude.campaign.record.config_file import COMMENTS, ConfigFile, parse_config
from etude.errors import UsageError
from etude.trajectories import FourierConfig

KINDS = {name: plugins.load("etude.robots", name) for name in ("arm", "quadrotor")}
NAMES = [(kind, name) for kind, found in KINDS.items() for name in found.presets]


def read(text: str) -> ConfigFile:
    return parse_config(text.encode(), "lab/campaign.toml")


def parse(text: str) -> CampaignConfig:
    named = text if "kind" in text else f'kind = "arm"\n{text}'
    return read(named).config


def preset(name: str, kind: str = "arm") -> CampaignConfig:
    return preset_config(KINDS[kind], name)


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_what_init_writes_reads_back(name: str, kind: str) -> None:
    config = replace(preset(name, kind), seed=11)
    found = read(config_text(config, KINDS[kind]))
    assert (found.config, found.kind.name) == (config, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_explained(kind: str) -> None:
    for section in SECTIONS:
        keys = {field.name for field in fields(getattr(preset("default", kind), section))}
        explained = {**COMMENTS.get(section, {}), **KINDS[kind].comments.get(section, {})}
        assert keys <= set(explained), f"[{section}] of {kind}"
        assert set(COMMENTS.get(section, {})) <= keys, f"comments of [{section}]"
        assert set(KINDS[kind].comments.get(section, {})) <= keys, f"{kind}'s comments of [{section}]"


def test_a_file_without_a_kind_is_refused() -> None:
    with pytest.raises(UsageError, match="does not state the kind") as caught:
        read("seed = 1\n")
    assert 'kind = "arm"' in caught.value.next_step


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("submarine", "there is no kind of robot 'submarine'"),
        ("arms", "Did you mean arm"),
        (3, "kind = 3"),
    ],
)
def test_kinds_that_nobody_brings(kind: object, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse(f"kind = {kind!r}\n")
    assert caught.value.where == "lab/campaign.toml kind"


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
    assert config.trajectory == FourierConfig(rest="ramp", omega0=omega0)  # type: ignore[arg-type]


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
            r'harmonics takes a whole number, not "five".*\[trajectory\] harmonics',
        ),
        ('[stop]\nconsecutive = "two"', 'takes a whole number, not "two".*Write it as in consecutive = 2'),
        ("[log.columns]\nq_x = 3", "columns.q_x takes a text in quotes, not 3.*log.* columns.q_x"),
        ('[design]\ncriterion = "lvr"', "there is no criterion 'lvr'.*Did you mean ivr"),
        ('[model]\nkernel = "structurd"', "there is no kernel 'structurd'.*Did you mean structured"),
        ("[stop]\nconsecutive = 0", "must be 1 or more.*Change that value in the file"),
        ("[trajectory]\nharmonics = 2.5", "harmonics takes a whole number, not 2.5"),
        ("[trajectory]\nharmonics = true", "harmonics takes a whole number, not true"),
        ("[trajectory]\nharmonics = -1", r"harmonics >= 1.*\[trajectory\]"),
        ('[trajectory]\nrest = "ramp"\nomega0 = [0.5, 0.1]', "0.5..0.1"),
        ("[trajectory]\nduration = nan", "duration|omega0"),
        ("[trajectory]\nduration = inf", "duration|omega0"),
        ('[trajectory]\nrest = "sleep"', 'not "sleep"'),
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
        ("[trajectory\nharmonics = 5", "not valid TOML"),
        ("\x00", "not valid TOML"),
        ("seed = 1\nseed = 2", "not valid TOML"),
    ],
)
def test_impossible_edits_name_file_and_key(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse(text)
    assert "lab/campaign.toml" in caught.value.where


def test_bytes_that_are_no_text_are_refused() -> None:
    with pytest.raises(UsageError, match="not valid TOML"):
        parse_config(b"\xff\xfe", "lab/campaign.toml")


def test_no_campaign_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no campaign here.*etude init"):
        load_config(tmp_path)


def test_a_table_of_columns_can_be_added_at_the_end(tmp_path: Path) -> None:
    """As messages and docs say; a written one is read again."""
    campaign, _ = create_campaign(tmp_path / "lab", "arm4")
    path = campaign.path / "campaign.toml"
    path.write_text(path.read_text() + '[log.columns]\ncommand = "TorqueSm"\n"q_waist [deg]" = "ActPos1"\n')
    wanted = {"command": "TorqueSm", "q_waist [deg]": "ActPos1"}
    config = open_campaign(campaign.path).config
    assert config.log.columns == wanted
    path.write_text(config_text(config, campaign.kind))
    assert open_campaign(campaign.path).config.log.columns == wanted
