"""Drivers that come with Étude, each for one family of robots; see `etude.drivers`."""
