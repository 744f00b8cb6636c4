"""How far a robot stays from itself and from what stands around it, proved for all times."""
