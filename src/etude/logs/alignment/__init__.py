"""Alignment: the motion that a log shows, and its start."""
