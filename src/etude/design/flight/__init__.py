"""Design of the next flight."""
