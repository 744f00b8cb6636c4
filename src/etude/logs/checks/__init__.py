"""Checks of logs: plausibility, and quality of the recording. `plausibility` runs the tests in order."""
