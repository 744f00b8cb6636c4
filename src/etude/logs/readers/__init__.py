"""From files to tables of raw columns: one module a format."""
