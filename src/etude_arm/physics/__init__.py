"""Physics of a joint's command: kinematic tree, drives, base parameters, identification."""
