"""Which motion a log shows, and when it starts."""
