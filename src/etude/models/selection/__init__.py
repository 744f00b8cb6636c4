"""Model selection: candidate structures of each command, comparison, averaging."""
