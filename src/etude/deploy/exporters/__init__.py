"""Exporters: formats of robots' own players. Each exporter writes bytes and reads them back as the player
does.

A new one is a `protocols.Exporter`, like `joint_trajectory.py`, with a row of `etude.exporters` in
plugins.py.
"""
