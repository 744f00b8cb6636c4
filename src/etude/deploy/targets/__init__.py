"""Targets of `etude export`: what a model is written as, for other programs to run.

A new one is a `protocols.Target`, like `parameters.py` or `c99/target.py`, with a row of `etude.targets` in
plugins.py.
"""
