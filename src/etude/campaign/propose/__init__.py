"""Proposal of the next motion from the record: design, approach, certificate, files."""
