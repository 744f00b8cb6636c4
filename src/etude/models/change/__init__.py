"""Change detection: evidence in new logs, its onset and its diagnosis."""
