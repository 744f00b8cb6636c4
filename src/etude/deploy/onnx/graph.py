"""A graph of ONNX as it grows: nodes with names of their own, constants once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from etude._runtime.operators import Value

OPSET = 17
"""Of the operators: ReduceSum takes its axes as an input since 13."""
FORMAT = 8
"""Version of the file format, as of ONNX 1.10 to 1.13, whose releases brought opsets up to 17 and 18."""


@dataclass(frozen=True)
class Graph:
    """Operators of numbers of one type.

    Attributes:
        dtype: np.float64 or np.float32.
    """

    dtype: Any
    nodes: list[Any] = field(default_factory=list)
    constants: dict[tuple[bytes, tuple[int, ...], str], str] = field(default_factory=dict)
    values: list[Any] = field(default_factory=list)

    def op(self, name: str, *inputs: Any, **attributes: Any) -> str:
        """The name of what an operator makes of these: names of values, or arrays, which become constants."""
        from onnx import helper

        own = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        out = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(name, own, [out], name=f"n{len(self.nodes)}", **attributes))
        return out

    def constant(self, value: Any) -> str:
        """An array or a number; whole numbers stay whole."""
        from onnx import numpy_helper

        array = np.asarray(value)
        array = np.ascontiguousarray(array, dtype=np.int64 if array.dtype.kind in "iu" else self.dtype)
        array = array.reshape(np.shape(value))
        key = (array.tobytes(), array.shape, str(array.dtype))
        if key not in self.constants:
            self.constants[key] = f"c{len(self.constants)}"
            self.values.append(numpy_helper.from_array(array, self.constants[key]))
        return self.constants[key]

    def total(self, value: str, axis: int) -> str:
        """The sum along an axis, which goes."""
        return Value(self, value).sum(axis).name

    def columns(self, value: str, which: Sequence[int]) -> str:
        """Those columns of a table (n, D)."""
        return Value(self, value).at(which, axis=1).name

    def model(
        self,
        inputs: Mapping[str, int],
        outputs: Mapping[str, tuple[str, int]],
        words: Mapping[str, str],
        text: str,
    ) -> bytes:
        """The file: inputs (n, width) by name; outputs by name, (n, columns) of a value.

        Args:
            words: kept in the file beside the graph. text: what people read of it.
        """
        import onnx
        from onnx import TensorProto, helper

        kind = TensorProto.DOUBLE if self.dtype == np.float64 else TensorProto.FLOAT
        for name, (value, _) in outputs.items():
            self.nodes.append(helper.make_node("Identity", [value], [name]))
        graph = helper.make_graph(
            self.nodes,
            "model",
            [helper.make_tensor_value_info(name, kind, ["n", size]) for name, size in inputs.items()],
            [helper.make_tensor_value_info(name, kind, ["n", size]) for name, (_, size) in outputs.items()],
            self.values,
            doc_string=text,
        )
        made = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=FORMAT, producer_name="etude"
        )
        helper.set_model_props(made, dict(words))
        onnx.checker.check_model(made, full_check=True)
        return bytes(made.SerializeToString())
