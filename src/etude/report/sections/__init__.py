"""Sections of the report, one file for each; each is a function from the record to markup."""
