"""Model selection: candidates, comparison, averaging."""
