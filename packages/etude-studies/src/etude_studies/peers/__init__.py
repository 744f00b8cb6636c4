"""Other libraries that compute what Étude computes, timed beside it."""
