"""Has the robot changed? Evidence in new logs, its onset and its diagnosis."""
