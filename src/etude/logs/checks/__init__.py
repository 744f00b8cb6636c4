"""Is this log plausible, and how well was it recorded? `plausibility` runs the tests in their order."""
