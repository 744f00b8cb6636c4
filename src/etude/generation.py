"""The generation of what Étude writes: it grows when a fault of safety is mended, whatever the version says.

What was written without one is of generation 1. Which faults the earlier ones have is in
`campaign.known_faults`, and for people in docs/known_faults.md.
"""

GENERATION = 2
