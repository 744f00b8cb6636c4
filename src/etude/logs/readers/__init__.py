"""Readers: one module for each file format, from a file to a table of raw columns."""
