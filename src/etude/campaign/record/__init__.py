"""The record of a campaign: journal, state, configuration, stored files."""
