"""Checks of a log's plausibility and recording quality; `plausibility` runs them in their order."""
