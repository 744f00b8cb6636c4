"""What is different in a flying campaign."""
