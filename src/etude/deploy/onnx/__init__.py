"""A model as an ONNX graph, for runtimes that take those."""

PUBLIC = ("model_graph", "target")
"""Modules that may be used from outside."""
