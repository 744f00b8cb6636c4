"""A stand-in for any robot of joints, made from its own model file."""
