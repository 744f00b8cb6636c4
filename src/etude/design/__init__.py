"""What to run next: criteria, reference states and the search. See docs/architecture.md."""
