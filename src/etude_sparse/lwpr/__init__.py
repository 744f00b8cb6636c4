"""Locally weighted projection regression, with the interface of a Gaussian process as far as possible."""
