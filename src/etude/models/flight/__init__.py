"""Inverse models of flying vehicles."""
