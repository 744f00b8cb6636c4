"""A model as an ONNX graph, for runtimes that take those."""
