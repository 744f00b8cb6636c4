"""From a log file to the record: reading, questions, repeats, change of the robot."""
