"""Columns of raw logs as channels of a kind: names, units, indices, gaps."""
