"""Long functions of plain loops, compiled: a subset of Python through LLVM, kept on disk.

numba spends most of its time on types before LLVM sees a loop: half a minute for the longest functions, of
which LLVM needs a tenth. Here a function consists of loops over ranges, numbers and elements of arrays, and
the parts that it calls stand in their place. So every type is known where it stands, in one pass.
docs/decisions/0069-loop-compiler.md has the figures.
"""

from __future__ import annotations

import ast
import ctypes
import hashlib
import inspect
import os
import platform
import struct
import tempfile
import textwrap
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

INT, REAL, BIT = ir.IntType(64), ir.DoubleType(), ir.IntType(1)
DOUBLE = np.dtype(np.float64)
DATA, SIZES = object.__basicsize__, object.__basicsize__ + 16
"""Bytes from a NumPy array's object to the addresses of its elements and of its sizes: after the head of
every object stand `data`, `nd`, `dimensions` (PyArrayObject_fields in NumPy's ndarraytypes.h)."""
MATHS = ("reassoc", "contract", "nsz")
"""Sums may be reordered and fused, so that reductions vectorise; NaN and infinity keep their sense."""
SIGNED = ("nsw",)  # indices do not overflow
BINARY: Mapping[type[ast.operator], tuple[str, str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("add", "fadd", lambda a, b: a + b),
    ast.Sub: ("sub", "fsub", lambda a, b: a - b),
    ast.Mult: ("mul", "fmul", lambda a, b: a * b),
    ast.Div: ("", "fdiv", lambda a, b: a / b),
    ast.FloorDiv: ("sdiv", "", lambda a, b: a // b),
    ast.Mod: ("srem", "", lambda a, b: a % b),
    ast.BitAnd: ("and_", "", lambda a, b: a & b),
    ast.LShift: ("shl", "", lambda a, b: a << b),
}
"""Of each operator: LLVM's for integers, LLVM's for reals, Python's. Integers are not negative where they are
divided."""
COMPARED: Mapping[type[ast.cmpop], tuple[str, Callable[[Any, Any], bool]]] = {
    ast.Eq: ("==", lambda a, b: a == b),
    ast.NotEq: ("!=", lambda a, b: a != b),
    ast.Lt: ("<", lambda a, b: a < b),
    ast.LtE: ("<=", lambda a, b: a <= b),
    ast.Gt: (">", lambda a, b: a > b),
    ast.GtE: (">=", lambda a, b: a >= b),
}
FIXED = (int, float, bool)  # values that are known while the code is made


@dataclass(frozen=True)
class Part:
    """A function that stands in place of its calls in the same file; from Python it is called as it is."""

    function: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        """In Python, for tests."""
        return self.function(*arguments)


@dataclass(frozen=True)
class LaidOut:
    """An array of doubles in C order: its first element, and the sizes of its axes."""

    first: ir.Value
    shape: tuple[Any, ...]


@dataclass(frozen=True)
class Variable:
    """A name that is assigned more than once."""

    address: ir.Value


class CompiledLoops:
    """A function (arrays and integers) -> None, compiled at its first call for the numbers of axes it gets.

    Args:
        function: its parameters that are annotated `Array` are C-contiguous arrays of doubles, the others
            integers.
        columns: of the arrays whose last axis has a fixed size, by name: the compiler then knows that their
            rows do not overlap.
        exact: every sum and product is rounded where it stands, as in Python; else `MATHS`.
    """

    def __init__(
        self, function: Callable[..., None], columns: Mapping[str, int], *, exact: bool = False
    ) -> None:
        self.function, self.columns, self.exact = function, columns, exact
        self._made: dict[tuple[int, ...], tuple[Any, Any]] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: Any) -> None:
        """Runs it.

        Raises:
            TypeError: an array that is no C-contiguous array of doubles.
        """
        given, axes = [], []
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                if argument.dtype != DOUBLE or not argument.flags.c_contiguous:
                    raise TypeError(f"{self.function.__name__} takes C-contiguous arrays of doubles")
                given.append(id(argument))
                axes.append(argument.ndim)
            else:
                given.append(argument)
                axes.append(0)
        known = self._made.get(tuple(axes)) or self._make(tuple(axes))
        known[0](*given)

    def _make(self, axes: tuple[int, ...]) -> tuple[Any, Any]:
        with self._lock:
            if axes not in self._made:
                self._made[axes] = _loaded(self, axes)
            return self._made[axes]


def loops(
    columns: Mapping[str, int] = MappingProxyType({}), *, exact: bool = False
) -> Callable[[Callable[..., None]], CompiledLoops]:
    """Decorator: `CompiledLoops`."""
    return lambda function: CompiledLoops(function, columns, exact=exact)


@lru_cache
def fused_in_one_instruction() -> bool:
    """Whether this processor multiplies and adds in one step; if not, `fused` is slow."""
    return platform.machine().lower() not in ("x86_64", "amd64") or bool(llvm.get_host_cpu_features()["fma"])


def fused(a: float, b: float, c: float) -> float:
    """a b + c, rounded once."""
    return float(Fraction(a) * Fraction(b) + Fraction(c))


def bits(value: float) -> int:
    """The bits of a double as a signed integer."""
    return int.from_bytes(struct.pack("<d", value), "little", signed=True)


def number(first: int, second: int) -> float:
    """The double whose bits are the sum of these, modulo 2^64."""
    (value,) = struct.unpack("<d", ((first + second) % 2**64).to_bytes(8, "little"))
    return float(value)


# --- from a machine's code to a function ------------------------------------------------------------------


def _loaded(loops: CompiledLoops, axes: tuple[int, ...]) -> tuple[Any, Any]:
    """The function as ctypes calls it, and the engine that owns its code."""
    name, machine = loops.function.__name__, _machine()
    settings = repr((axes, sorted(loops.columns.items()), loops.exact))
    code = _kept(loops.function, settings, lambda: _object(loops, axes))
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    types = [ctypes.c_int64] * len(axes)
    return ctypes.CFUNCTYPE(None, *types)(engine.get_function_address(name)), engine


def _machine() -> Any:
    """The processor that this runs on; an engine owns its own."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        codemodel="jitdefault",
        jit=True,
    )


def _object(loops: CompiledLoops, axes: tuple[int, ...]) -> bytes:
    """Machine code of the function."""
    machine = _machine()
    module = llvm.parse_assembly(str(_Maker(loops, axes).module))
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    # with loops unrolled too, LLVM takes twice as long, and the sweeps are no faster
    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    tuning.loop_unrolling = False
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    code: bytes = machine.emit_object(module)
    return code


@lru_cache
def _text(function: Callable[..., Any]) -> str:
    return textwrap.dedent(inspect.getsource(function))


def _kept(function: Callable[..., Any], settings: str, make: Callable[[], bytes]) -> bytes:
    """The code on disk, or what `make` gives, which is then kept in the first folder that can be written.

    The name holds everything that the code depends on: the whole file, since its constants and its parts are
    in it, this file, LLVM, and the processor.
    """
    source = Path(inspect.getfile(function))
    written = [path.read_bytes() for path in (source, Path(__file__)) if path.is_file()]
    told = (settings, llvmlite.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    key = hashlib.sha256(b"\0".join([*written, *(part.encode() for part in told)])).hexdigest()[:16]
    paths = [folder / f"{source.stem}.{function.__name__}.{key}.o" for folder in _folders(source)]
    known = next(filter(None, map(_read, paths)), None)
    if known is not None:
        return known
    code = make()
    for path in paths:
        if _written(path, hashlib.sha256(code).digest() + code):
            break
    return code


def _folders(source: Path) -> list[Path]:
    """As numba's: NUMBA_CACHE_DIR, or beside the bytecode of the source, or the user's."""
    configured = os.environ.get("NUMBA_CACHE_DIR")
    if configured:
        return [Path(configured)]
    own = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    beside = source.parent / "__pycache__"
    return [beside, own / "etude"] if own.is_absolute() else [beside]  # a container's user may have no home


def _read(path: Path) -> bytes | None:
    """The code in a file; None without one, or if it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return content[32:] if hashlib.sha256(content[32:]).digest() == content[:32] else None


def _written(path: Path, content: bytes) -> bool:
    """Whether a file has been written: whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=path.parent)
    except OSError:
        return False
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)  # others may use the same installation
        os.replace(name, path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        return False
    return True


# --- from Python to LLVM ----------------------------------------------------------------------------------


@dataclass
class _Frame:
    """The function or part that is being translated.

    Attributes:
        names: values of its names; often: those that are assigned more than once.
        globals: of its file. after: where the next round of the innermost loop begins.
    """

    names: dict[str, Any]
    often: set[str]
    globals: Mapping[str, Any]
    after: ir.Block | None = None


class _Maker:
    """The module of one function."""

    def __init__(self, loops: CompiledLoops, axes: tuple[int, ...]) -> None:
        function, columns = loops.function, loops.columns
        self.module, self.file = ir.Module(function.__name__), inspect.getfile(function)
        self.maths = () if loops.exact else MATHS
        kind = ir.FunctionType(ir.VoidType(), [INT] * len(axes))
        made = ir.Function(self.module, kind, function.__name__)
        self.entry = ir.IRBuilder(made.append_basic_block("variables"))
        self.builder = ir.IRBuilder(made.append_basic_block("begin"))
        self.frame = _Frame({}, set(), {})
        given: list[Any] = []
        for name, count, value in zip(inspect.signature(function).parameters, axes, made.args, strict=True):
            given.append(self._block(value, count, columns.get(name)) if count else value)
        first = self.entry.block
        self.inline(function, given)
        self.builder.ret_void()
        self.entry.position_at_end(first)
        self.entry.branch(made.blocks[1])

    def _block(self, array: ir.Value, axes: int, columns: int | None) -> LaidOut:
        """The elements and sizes of a NumPy array, from the address of its object."""
        build = self.builder

        def field(at: int, kind: ir.Type) -> ir.Value:
            place = build.add(array, ir.Constant(INT, at))
            return build.load(build.inttoptr(place, kind.as_pointer()))

        sizes = field(SIZES, INT.as_pointer())
        shape = [build.load(build.gep(sizes, [ir.Constant(INT, axis)])) for axis in range(axes)]
        if columns is not None:
            shape[-1] = columns
        return LaidOut(field(DATA, REAL.as_pointer()), tuple(shape))

    def inline(self, function: Callable[..., Any], given: Sequence[Any]) -> Any:
        """The body of a function with these arguments, and what it returns."""
        (definition,) = ast.parse(_text(function)).body
        assert isinstance(definition, ast.FunctionDef)
        outer = self.frame
        names = dict(zip((a.arg for a in definition.args.args), given, strict=True))
        self.frame = _Frame(names, _assigned_often(definition), function.__globals__)
        for name in self.frame.often & names.keys():
            self.assign(name, names[name])
        result = self.run(definition.body)
        self.frame = outer
        return result

    def run(self, statements: Sequence[ast.stmt]) -> Any:
        """Translates statements; the value of a `return`, which is the last, or None."""
        for statement in statements:
            if isinstance(statement, ast.Return):
                return None if statement.value is None else self.value(statement.value)
            handler = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if handler is None:
                raise SyntaxError(f"loops know no {ast.unparse(statement)}")
            handler(statement)
        return None

    def _expr(self, statement: ast.Expr) -> None:
        if not isinstance(statement.value, ast.Constant):  # a docstring
            self.value(statement.value)

    def _assign(self, statement: ast.Assign) -> None:
        (target,) = statement.targets
        if isinstance(target, ast.Tuple):
            assert isinstance(statement.value, ast.Tuple)
            values = [self.value(part) for part in statement.value.elts]
            for part, value in zip(target.elts, values, strict=True):
                self.store(part, value)
        else:
            self.store(target, self.value(statement.value))

    def _augassign(self, statement: ast.AugAssign) -> None:
        read = ast.parse(ast.unparse(statement.target), mode="eval").body
        self.store(statement.target, self.binary(statement.op, self.value(read), self.value(statement.value)))

    def _for(self, statement: ast.For) -> None:
        assert isinstance(statement.iter, ast.Call)
        assert isinstance(statement.target, ast.Name)
        bounds = [self.value(argument) for argument in statement.iter.args]
        start, stop, step = ([0, *bounds, 1] if len(bounds) == 1 else [*bounds, 1])[:3]
        with self.counted(start, stop, step) as (index, after):
            self.frame.names[statement.target.id] = index
            outer, self.frame.after = self.frame.after, after
            self.run(statement.body)
            self.frame.after = outer

    @contextmanager
    def counted(self, start: Any, stop: Any, step: Any) -> Iterator[tuple[ir.Value, ir.Block]]:
        """A loop: its index, and where the next round begins."""
        build, append = self.builder, self.builder.function.append_basic_block
        head, body, after, end = append("head"), append("body"), append("next"), append("end")
        before, first = build.block, self.made(start)
        build.branch(head)
        build.position_at_end(head)
        index = build.phi(INT)
        index.add_incoming(first, before)
        down = isinstance(step, int) and step < 0
        build.cbranch(build.icmp_signed(">" if down else "<", index, self.made(stop)), body, end)
        build.position_at_end(body)
        yield index, after
        build.branch(after)
        build.position_at_end(after)
        index.add_incoming(build.add(index, self.made(step), flags=SIGNED), after)
        build.branch(head)
        build.position_at_end(end)

    def _if(self, statement: ast.If) -> None:
        test = self.value(statement.test)
        if isinstance(test, FIXED):
            self.run(statement.body if test else statement.orelse)
            return
        build, append = self.builder, self.builder.function.append_basic_block
        yes, no, end = append("yes"), append("no"), append("both")
        build.cbranch(self.bit(test), yes, no)
        for block, statements in ((yes, statement.body), (no, statement.orelse)):
            build.position_at_end(block)
            if len(statements) == 1 and isinstance(statements[0], ast.Continue):
                build.branch(self.frame.after)
                continue
            self.run(statements)
            build.branch(end)
        build.position_at_end(end)

    def store(self, target: ast.expr, value: Any) -> None:
        """value into a name or an element."""
        if isinstance(target, ast.Name):
            self.assign(target.id, value)
        else:
            assert isinstance(target, ast.Subscript)
            self.builder.store(self.real(value), self.address(target))

    def assign(self, name: str, value: Any) -> None:
        """A name that is assigned once is its value; others have a place, which LLVM makes registers of."""
        if name not in self.frame.often or isinstance(value, LaidOut):
            self.frame.names[name] = value
            return
        kind = self.made(value).type
        known = self.frame.names.get(name)
        if not isinstance(known, Variable) or known.address.type.pointee != kind:
            known = self.frame.names[name] = Variable(self.entry.alloca(kind, name=name))
        self.builder.store(self.made(value), known.address)

    def address(self, element: ast.Subscript) -> ir.Value:
        """Of an element of an array, in C order."""
        block = self.value(element.value)
        indices = element.slice.elts if isinstance(element.slice, ast.Tuple) else [element.slice]
        assert len(indices) == len(block.shape), ast.unparse(element)
        at: Any = 0
        for index, size in zip(indices, block.shape, strict=True):
            at = self.binary(ast.Add(), self.binary(ast.Mult(), at, size), self.value(index))
        return self.builder.gep(block.first, [self.made(at)], inbounds=True)

    def value(self, expression: ast.expr) -> Any:
        """A number that is known now, an LLVM value, a block, or a function."""
        match expression:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                found = self.frame.names[name] if name in self.frame.names else self.frame.globals.get(name)
                if isinstance(found, np.ndarray):
                    return self.constant(name, found)
                return self.builder.load(found.address) if isinstance(found, Variable) else found
            case ast.Subscript(
                value=ast.Attribute(value=array, attr="shape"), slice=ast.Constant(value=axis)
            ):
                return self.value(array).shape[axis]
            case ast.Subscript():
                return self.builder.load(self.address(expression))
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(op, self.value(left), self.value(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.binary(ast.Mult(), -1, self.value(operand))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.builder.not_(self.bit(self.value(operand)))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self.compare(op, self.value(left), self.value(right))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.select(self.value(test), self.value(body), self.value(orelse))
            case ast.Call(func=ast.Name(id=name), args=arguments):
                part, given = self.frame.globals.get(name), [self.value(argument) for argument in arguments]
                if isinstance(part, Part) and inspect.getfile(part.function) == self.file:
                    return self.inline(part.function, given)
                if name in _BUILT_IN:
                    return _BUILT_IN[name](self, *given)
        raise SyntaxError(f"loops know no {ast.unparse(expression)}")

    def constant(self, name: str, values: Any) -> LaidOut:
        """An array of doubles (n,) of the file: nothing that the function writes overlaps it."""
        kept = self.module.globals.get(name)
        if kept is None:
            kind = ir.ArrayType(REAL, len(values))
            kept = ir.GlobalVariable(self.module, kind, name)
            kept.linkage, kept.global_constant = "internal", True
            kept.initializer = ir.Constant(kind, values.tolist())
        zero = ir.Constant(INT, 0)
        return LaidOut(self.builder.gep(kept, [zero, zero]), values.shape)

    def binary(self, op: ast.operator, a: Any, b: Any) -> Any:
        """a op b; of two integers an integer, but for `/`."""
        whole, real, python = BINARY[type(op)]
        if isinstance(a, FIXED) and isinstance(b, FIXED):
            return python(a, b)
        if whole and self.made(a).type == INT and self.made(b).type == INT:
            flags = SIGNED if whole in ("add", "sub", "mul") else ()
            return getattr(self.builder, whole)(self.made(a), self.made(b), flags=flags)
        return getattr(self.builder, real)(self.real(a), self.real(b), flags=self.maths)

    def compare(self, op: ast.cmpop, a: Any, b: Any) -> Any:
        """A bit."""
        sign, python = COMPARED[type(op)]
        if isinstance(a, FIXED) and isinstance(b, FIXED):
            return python(a, b)
        if self.made(a).type == INT and self.made(b).type == INT:
            return self.builder.icmp_signed(sign, self.made(a), self.made(b))
        return self.builder.fcmp_ordered(sign, self.real(a), self.real(b))

    def select(self, test: Any, a: Any, b: Any) -> Any:
        """a if test else b; both have been computed."""
        if isinstance(test, FIXED):
            return a if test else b
        whole = self.made(a).type == INT and self.made(b).type == INT
        as_one = self.made if whole else self.real
        return self.builder.select(self.bit(test), as_one(a), as_one(b))

    def made(self, value: Any) -> ir.Value:
        """An LLVM value."""
        if isinstance(value, float):
            return ir.Constant(REAL, value)
        return ir.Constant(INT, int(value)) if isinstance(value, (int, bool)) else value

    def real(self, value: Any) -> ir.Value:
        """As a double."""
        if isinstance(value, FIXED):
            return ir.Constant(REAL, float(value))
        return self.builder.sitofp(value, REAL) if value.type == INT else value

    def bit(self, value: Any) -> ir.Value:
        """Whether it is not zero."""
        return value if value.type == BIT else self.builder.icmp_signed("!=", value, ir.Constant(INT, 0))


def _assigned_often(definition: ast.FunctionDef) -> set[str]:
    """Names with several assignments, and parameters with one; those of loops are not among them."""
    counts = {a.arg: 1 for a in definition.args.args}
    for node in ast.walk(definition):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            counts[node.id] = counts.get(node.id, 0) + 1
    rounds = (node.target for node in ast.walk(definition) if isinstance(node, ast.For))
    indices = {target.id for target in rounds if isinstance(target, ast.Name)}
    return {name for name, count in counts.items() if count > 1} - indices


def _absolute(maker: _Maker, value: Any) -> Any:
    return maker.builder.call(maker.module.declare_intrinsic("llvm.fabs", [REAL]), [maker.real(value)])


def _least(maker: _Maker, a: Any, b: Any) -> Any:
    return maker.select(maker.compare(ast.Lt(), b, a), b, a)


def _fused(maker: _Maker, a: Any, b: Any, c: Any) -> Any:
    given = [maker.real(value) for value in (a, b, c)]
    kind = ir.FunctionType(REAL, [REAL] * 3)
    return maker.builder.call(maker.module.declare_intrinsic("llvm.fma", [REAL], kind), given)


def _bits(maker: _Maker, value: Any) -> Any:
    return maker.builder.bitcast(maker.real(value), INT)


def _number(maker: _Maker, first: Any, second: Any) -> Any:
    return maker.builder.bitcast(maker.builder.add(maker.made(first), maker.made(second)), REAL)


_BUILT_IN: Mapping[str, Callable[..., Any]] = {
    "abs": _absolute,
    "min": _least,
    "fused": _fused,
    "bits": _bits,
    "number": _number,
}
