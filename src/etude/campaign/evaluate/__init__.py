"""Evaluation of a campaign: status, stop rule, confirmation."""
