"""Fixtures of the campaign tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_robot import make_campaign

from etude.campaign import Campaign


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path)
