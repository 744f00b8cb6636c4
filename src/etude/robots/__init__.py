"""The kinds of robots: a package each, and what they share to be read from files."""

PUBLIC = ()
"""Modules that may be used from outside."""
