"""What happened in a campaign and where it is kept: journal, state, configuration, stored files."""
