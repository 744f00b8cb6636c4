"""Record of a campaign: journal, state, configuration, stored files."""
