"""Loading of URDF and MJCF files into a model of the chosen joints, with masses and shapes."""
