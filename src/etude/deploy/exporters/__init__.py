"""Exporters: formats of robots' own players. Each exporter writes bytes and reads them back as the player
does.
"""
