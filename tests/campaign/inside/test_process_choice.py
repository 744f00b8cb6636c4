"""A campaign with another member of the model family: told, asked and told again through files alone."""

from __future__ import annotations

import pytest
from small_robot import make_campaign, random_motion, write_log

from etude import ask, status, tell
from etude.campaign import newest_model, stored_trajectory
from etude.campaign.record.config_file import parse_config
from etude.errors import UsageError

pytestmark = pytest.mark.as_logged

CONFIG = """\
[trajectory]
duration = 20.0
[data]
cutoff_hz = 5.0
[model]
rung = "gp"
kernel = "ard_se"
process = "{process}"
points = 60
fit_points = 60
basis = 20
steps = 5
[design]
candidates = 4
refine = 1
steps = 3
points = 20
reference_points = 20
"""


@pytest.mark.parametrize(
    ("process", "kind"),
    [
        ("dictionary_variance", "ExactPosterior"),
        pytest.param("ssgp_fixed", "SparseSpectrumPosterior", marks=pytest.mark.slow),
        pytest.param("vfe", "BasisPosterior", marks=pytest.mark.slow),
        pytest.param("local_gp", "LocalPosterior", marks=pytest.mark.slow),
        pytest.param("lwpr", "LWPRPosterior", marks=pytest.mark.slow),
    ],
)
def test_a_campaign_learns_and_designs_with_it(process, kind, tmp_path) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG.format(process=process))
    tell(campaign, write_log(tmp_path / "foreign.csv", random_motion(campaign, 3)))
    number = ask(campaign).number
    tell(campaign, write_log(tmp_path / "answer.csv", stored_trajectory(campaign, number), number))
    _, second = campaign.state().trained
    assert second.trained is not None
    # after one motion of 20 s a local process knows less of another motion than one process of all samples
    # and of twenty spectral points, hardly trained, it depends on the draw: 0.6 to 2.1 over four motions
    worst = {"local_gp": 0.8, "lwpr": 0.8, "ssgp_fixed": 3.0}.get(process, 0.5)
    assert max(second.trained.models["gp"].nmse) < worst
    assert second.trained.moved is not None
    model = newest_model(campaign, campaign.state())
    assert model is not None
    own = [p for c in model.candidates if c.structure == "gp" for p in c.process.own]
    assert len(own) == 2
    assert all(type(posterior).__name__ == kind for posterior in own)
    assert status(campaign)


def test_an_unknown_process_is_refused_with_the_file_the_key_and_the_names() -> None:
    with pytest.raises(UsageError, match="there is no member of the model family 'magic'") as caught:
        parse_config(b'kind = "arm"\n[model]\nprocess = "magic"\n', "campaign.toml")
    assert "campaign.toml [model] model.process" in str(caught.value.where)
