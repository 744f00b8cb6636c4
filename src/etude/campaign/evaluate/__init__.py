"""Evaluation: status, stop rule, confirmation."""
