"""One file per command: a frozen dataclass that the command line fills, with a `run` that returns an Outcome."""
