"""Targets of `etude export`: what a model is written as, for other programs to run."""
