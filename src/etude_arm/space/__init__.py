"""Limits of an arm in space: how fast its tool and its links move, and where the tool stays."""
