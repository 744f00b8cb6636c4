"""The page's logging configuration names columns that the reader knows."""

from __future__ import annotations

from test_docs import ROOT, blocks

from etude_quadrotor.logs.usd_card import HEADERS


def test_what_the_card_is_told_to_log_is_read() -> None:
    (block,) = blocks(ROOT / "docs" / "logs_crazyflie.md", "text")
    logged = block.partition("on:fixedFrequency\n")[2].split()
    assert len(logged) == 18
    assert set(logged) <= set(HEADERS)
