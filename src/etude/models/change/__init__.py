"""Detection of a changed robot: evidence in new logs, its onset and its diagnosis."""
