"""The mean of squared-exponential processes as an ONNX graph, for a comparison of speed alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from etude.models.model import LearnedModel


def session(model: LearnedModel, dtype: Any) -> Callable[[Any], Any]:
    """x (1, D) -> the means, by onnxruntime on one thread."""
    import onnx
    import onnxruntime
    from onnx import TensorProto, helper, numpy_helper

    (candidate,) = model.candidates
    process: Any = candidate.process
    lengths = np.stack([np.exp(p.theta[1:]) for p in process.own])
    points = np.stack([p.X / ell for p, ell in zip(process.own, lengths, strict=True)])
    weights = np.stack([p.alpha * np.exp(2.0 * p.theta[0]) for p in process.own])
    constants = {
        "lengths": 1.0 / lengths[:, None, :],
        "points": points,
        "weights": weights * candidate.units[1][:, None],
        "half": np.array(-0.5),
    }
    kind = TensorProto.DOUBLE if dtype == np.float64 else TensorProto.FLOAT
    nodes = [
        helper.make_node("Mul", ["x", "lengths"], ["u"]),
        helper.make_node("Sub", ["u", "points"], ["apart"]),
        helper.make_node("Mul", ["apart", "apart"], ["squares"]),
        helper.make_node("ReduceSum", ["squares", "axes"], ["sums"], keepdims=0),
        helper.make_node("Mul", ["sums", "half"], ["exponents"]),
        helper.make_node("Exp", ["exponents"], ["covariances"]),
        helper.make_node("Mul", ["covariances", "weights"], ["terms"]),
        helper.make_node("ReduceSum", ["terms", "last"], ["mean"], keepdims=0),
    ]
    initial = [numpy_helper.from_array(np.asarray(v, dtype=dtype), n) for n, v in constants.items()]
    initial.append(numpy_helper.from_array(np.array([2], dtype=np.int64), "axes"))
    initial.append(numpy_helper.from_array(np.array([1], dtype=np.int64), "last"))
    graph = helper.make_graph(
        nodes,
        "mean",
        [helper.make_tensor_value_info("x", kind, [1, points.shape[2]])],
        [helper.make_tensor_value_info("mean", kind, [len(weights)])],
        initial,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(made)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    found = onnxruntime.InferenceSession(
        made.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    return lambda x: found.run(None, {"x": x})[0]
