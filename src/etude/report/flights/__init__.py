"""The parts of the page that only a flying vehicle's campaign has."""
