"""The Lagrangian polynomial prior: energies drawn from a process, commands by Lagrange's equations."""

PUBLIC = ("joints", "kernel", "member", "prior")
"""Modules that may be used from outside."""
