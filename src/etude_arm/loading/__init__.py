"""One way to load a robot: a URDF or MJCF becomes a model of the chosen joints, with masses and shapes."""
