"""From the record to the next motion: design, approach, certificate, files."""
