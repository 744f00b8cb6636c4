"""What happened in a campaign and where it is kept: journal, state, configuration, stored files."""

PUBLIC = ("config", "config_file", "controls", "folder", "journal", "rounds", "stored_models")
"""Modules that may be used from outside."""
