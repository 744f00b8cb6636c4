"""Étude: composes the motions that teach a robot's inverse dynamics in as little robot time as possible."""

__version__ = "0.1.0"
