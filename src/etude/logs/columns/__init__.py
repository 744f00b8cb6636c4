"""From raw columns to a kind's channels: names, units, indices, gaps."""
