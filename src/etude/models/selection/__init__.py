"""Which structure explains each command best: candidates, comparison, averaging."""
