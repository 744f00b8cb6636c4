"""Locally weighted projection regression: no Gaussian process, but it answers like one where it can."""
