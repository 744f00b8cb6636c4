"""The command line: one file per command, a frozen dataclass filled by tyro, with `run`."""

from etude.cli.entrance import main as main
