"""What physics says of a command: kinematic tree, drives, base parameters, identification."""
