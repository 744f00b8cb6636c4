"""`etude run`: the robot itself closes the loop; what may move it, when, and what is kept of that."""
