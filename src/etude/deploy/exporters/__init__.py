"""Exporters: formats of robots' own players. Each writes bytes, and reads them back as the player does."""
