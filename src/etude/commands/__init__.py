"""One file per command: a frozen dataclass filled from the command line, with `run`."""
