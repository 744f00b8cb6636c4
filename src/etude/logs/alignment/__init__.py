"""Alignment: the motion that a log shows, and the time at which it starts."""
