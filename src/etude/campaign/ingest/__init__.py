"""Ingest of log files into the record: reading, questions, repeated logs, change of the robot."""
