"""Cartesian limits of an arm: speed of its tool and links, and workspace of the tool."""
