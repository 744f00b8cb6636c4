"""Carrying out runs: in this process, in processes of this machine, or on a cluster.

An engine is anything of the shape of `concurrent.futures.Executor` that says how many calls it wants to have
at hand (`window`): `Inline`, `Workers`, and what `cluster.connect` gives.
"""
