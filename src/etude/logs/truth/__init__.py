"""Is this log true? One module a test: each takes what was seen of a motion and gives findings."""
