"""Is this log plausible, and how well was it recorded? One module a test."""
