"""Array operators for NumPy and for graphs: a sum written here becomes an operator in an ONNX graph.

Names of operators are those of ONNX. Numbers and arrays beside a value become constants of the graph. The
functions below take either, so that one formula serves both; where no value takes part, NumPy computes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, cast

import numpy as np

QUARTER = 0.5 * np.pi
"""cos x = sin (x + QUARTER): onnxruntime had no Cos of double before 1.23."""
T = TypeVar("T")
Operand = Any
"""A Value, an array or a number."""


class Operators(Protocol):
    """A graph as it grows. op: the name of what an operator makes of names of values, or of arrays."""

    def op(self, name: str, *inputs: Any, **attributes: Any) -> str: ...


@dataclass(frozen=True, eq=False)
class Value:
    """An array that will be there when the graph runs; its first axis counts instants."""

    graph: Operators
    name: str
    __array_ufunc__ = None  # so that array + Value is asked here

    def made(self, name: str, *inputs: Operand, **attributes: Any) -> Value:
        """Output of that operator applied to the inputs."""
        operands = [part.name if isinstance(part, Value) else part for part in inputs]
        return Value(self.graph, self.graph.op(name, *operands, **attributes))

    def __add__(self, other: Operand) -> Value:
        return self.made("Add", self, other)

    def __radd__(self, other: Operand) -> Value:
        return self.made("Add", other, self)

    def __sub__(self, other: Operand) -> Value:
        return self.made("Sub", self, other)

    def __rsub__(self, other: Operand) -> Value:
        return self.made("Sub", other, self)

    def __mul__(self, other: Operand) -> Value:
        return self.made("Mul", self, other)

    def __rmul__(self, other: Operand) -> Value:
        return self.made("Mul", other, self)

    def __truediv__(self, other: Operand) -> Value:
        return self.made("Div", self, other)

    def __matmul__(self, other: Operand) -> Value:
        return self.made("MatMul", self, other)

    def __rmatmul__(self, other: Operand) -> Value:
        return self.made("MatMul", other, self)

    def __neg__(self) -> Value:
        return self.made("Neg", self)

    def __abs__(self) -> Value:
        return self.made("Abs", self)

    def of(self, function: str) -> Value:
        """That function of each number: Sin, Tanh, Exp, Sqrt, Sign."""
        return self.made(function, self)

    def most(self, other: Operand) -> Value:
        """The larger of each two numbers."""
        return self.made("Max", self, other)

    def least(self, other: Operand) -> Value:
        """The smaller of each two numbers."""
        return self.made("Min", self, other)

    def sum(self, axis: int) -> Value:
        """Sum along an axis, which is removed."""
        return self.made("ReduceSum", self, np.array([axis]), keepdims=0)

    def at(self, places: Sequence[int], axis: int = -1) -> Value:
        """Selected indices of an axis, which is kept."""
        return self.made("Gather", self, np.array(list(places)), axis=axis)

    def shaped(self, *sizes: int) -> Value:
        """The same numbers as another array; -1: as many as there are."""
        return self.made("Reshape", self, np.array(sizes))

    def widened(self, axis: int) -> Value:
        """With one more axis, of one place."""
        return self.made("Unsqueeze", self, np.array([axis]))

    def swapped(self, *order: int) -> Value:
        """Its axes in that order."""
        return self.made("Transpose", self, perm=list(order))


@dataclass(frozen=True, eq=False)
class Piece:
    """Inputs or a mean as a part of a graph (`abilities.SupportsOnnx`).

    Attributes:
        reads: channels, in order.
        draw: channels (n, parts) by name, and the memory (n, words), None if nobody looks at what it is for
            -> inputs (n, D) or commands (n, J), and the memory after, None where there is none.
        memory: words that it remembers from one instant to the next, all 0 to begin.
        rate: Hz at which it must be asked, as it remembers; 0: anyhow.
    """

    reads: tuple[str, ...]
    draw: Callable[[Mapping[str, Value], Value | None], tuple[Value, Value | None]]
    memory: int = 0
    rate: float = 0.0


def joined(parts: Sequence[T], axis: int = -1) -> T:
    """Concatenation along an axis."""
    arrays: Sequence[Any] = parts
    if not isinstance(arrays[0], Value):
        return cast(T, np.concatenate(arrays, axis=axis))
    return cast(T, arrays[0] if len(arrays) == 1 else arrays[0].made("Concat", *arrays, axis=axis))


def stacked(parts: Sequence[Operand], axis: int = 0) -> Operand:
    """Arrays of one shape beside each other along a new axis; beside values, numbers are of every instant."""
    like = next((part for part in parts if isinstance(part, Value)), None)
    if like is None:
        return np.stack(parts, axis=axis)
    nothing = like * 0.0
    values = [part if isinstance(part, Value) else nothing + part for part in parts]
    return joined([part.widened(axis) for part in values], axis)


def column(a: Operand, place: int) -> Operand:
    """(n, 1): one column of (n, k)."""
    return a.at([place]) if isinstance(a, Value) else a[:, place, None]


def picked(a: Operand, place: int) -> Operand:
    """Element of the first axis, which is removed."""
    return a.at([place], 0).sum(0) if isinstance(a, Value) else a[place]


def widened(a: Operand, axis: int) -> Operand:
    """With one more axis, of one place."""
    return a.widened(axis) if isinstance(a, Value) else np.expand_dims(a, axis)


def swapped(a: Operand, *order: int) -> Operand:
    """Its axes in that order."""
    return a.swapped(*order) if isinstance(a, Value) else np.transpose(a, order)


def root(a: Operand) -> Operand:
    """Of each number."""
    return a.of("Sqrt") if isinstance(a, Value) else np.sqrt(a)


def tanh(a: Operand) -> Operand:
    """Of each number."""
    return a.of("Tanh") if isinstance(a, Value) else np.tanh(a)


def sine(angle: Operand) -> Operand:
    """Of each number."""
    return angle.of("Sin") if isinstance(angle, Value) else np.sin(angle)


def cosine(angle: Operand) -> Operand:
    """Of each number."""
    return (angle + QUARTER).of("Sin") if isinstance(angle, Value) else np.cos(angle)


def shaped(a: Operand, *sizes: int) -> Operand:
    """The same numbers as another array; -1: as many as there are."""
    return a.shaped(*sizes) if isinstance(a, Value) else np.reshape(a, sizes)


def cross(a: Operand, b: Operand) -> Operand:
    """a x b of vectors (..., 3); of arrays to the bit as np.cross, which spends most of a tick on its
    generality.
    """
    if isinstance(a, Value) or isinstance(b, Value):
        return _cycled(a, 1) * _cycled(b, 2) - _cycled(a, 2) * _cycled(b, 1)
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product = np.empty((*x.shape, 3), x.dtype)  # np.stack alone takes as long as all of this
    product[..., 0] = x
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _cycled(v: Operand, by: int) -> Operand:
    places = [(i + by) % 3 for i in range(3)]
    return v.at(places) if isinstance(v, Value) else np.asarray(v)[..., places]
