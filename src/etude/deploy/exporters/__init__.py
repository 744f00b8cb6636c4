"""Formats that a robot's own software plays: each writes bytes, and reads them back as it would."""
