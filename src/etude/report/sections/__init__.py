"""One file for each part of the report; each is a function from what was read to markup."""
