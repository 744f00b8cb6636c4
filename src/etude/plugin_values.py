"""Validation of plug-in results against the protocols that declare them.

One object stands before another. It has the members that the other has, reads each through the annotations
of `etude.protocols` and `etude.abilities`, and names the plug-in where a value is another. A shape stands
beside an array's type, `Annotated[Array, "(k,)"]`; "NaN" after it allows what is not finite. "keys a, b"
stands beside a mapping's type, "not empty" beside a sequence's.
"""

from __future__ import annotations

import collections.abc
import contextlib
import dataclasses
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from etude import abilities, protocols
from etude._runtime.trusted_folders import OWN
from etude.errors import UsageError
from etude.protocols import members

NEXT = "Correct the plug-in: etude.{}.{} declares the interface. No stored data was lost."
WORDS = {"Kind": "kind of robot", "Reader": "reader", "Exporter": "exporter", "Limit": "limit"}
KEYS, NOT_EMPTY = "keys ", "not empty"
TEXT = 40
"""Characters of a value that a sentence quotes."""
NUMBERS: Mapping[type, tuple[type, ...]] = {
    bool: (bool, np.bool_),
    int: (int, np.integer),
    float: (int, float, np.integer, np.floating),
}
"""What counts as a Python number of each type."""

Sizes = Mapping[str, int]


@dataclasses.dataclass(frozen=True)
class Declared:
    """A member: what it gives, the protocol that says so, whether it is called, and has a shape."""

    hint: Any
    protocol: type
    is_method: bool
    shaped: bool


class WrongValueError(Exception):
    """A value that is not of its type, in words that follow "returned"."""


def guarded(value: Any, part: str, name: str, sizes: Callable[[Any], Sizes] | None = None) -> Any:
    """An object with the same members, that raises UsageError where a value is not what its protocol says.

    Args:
        value: what a plug-in brings. part: the name of its protocol in `etude.protocols`. name: for messages.
        sizes: of the letters in shapes, from a robot's description, the first argument of most members.

    Raises:
        UsageError: a method is none, or an attribute has another type.
    """
    declarations = {
        member: declared for member, declared in _declared(part).items() if hasattr(value, member)
    }
    kind = type(f"Guarded{part}", (_Guarded,), {member: _reader(member) for member in declarations})
    guard = kind(value, part, name, declarations, sizes)
    for member in declarations:
        _value(guard, member)
    return guard


def is_guarded(value: object) -> bool:
    """Whether this is a plug-in's object, as `guarded` gives it."""
    return issubclass(type(value), _Guarded)


class _Guarded:
    """Stands before a plug-in's object; the members that its protocols declare are added to a subclass."""

    def __init__(
        self,
        value: Any,
        part: str,
        name: str,
        declarations: Mapping[str, Declared],
        sizes: Callable[[Any], Sizes] | None,
    ) -> None:
        self._wrapped, self._part, self._name, self._declarations, self._sizes = (
            value,
            part,
            name,
            declarations,
            sizes,
        )

    @property  # type: ignore[misc]
    def __class__(self) -> type:
        # a plug-in that is handed its own object back asks for its own type
        kind: type = type(self._wrapped)
        return kind

    def __getattr__(self, member: str) -> Any:
        return getattr(object.__getattribute__(self, "_wrapped"), member)

    def __repr__(self) -> str:
        return repr(self._wrapped)


def _reader(member: str) -> Any:
    if member == "__call__":
        return lambda guard, *given, **named: _called(guard, member)(*given, **named)
    return property(lambda guard: _value(guard, member))


def _value(guard: _Guarded, member: str) -> Any:
    """The attribute, or the method with its answer held against the protocol."""
    value, declared = getattr(guard._wrapped, member), guard._declarations[member]
    if not declared.is_method:
        return _checked(guard, member, value, {})
    if not callable(value):
        raise _error(guard, member, f"{_as_text(value)}, not a method")
    return _called(guard, member)


def _called(guard: _Guarded, member: str) -> Callable[..., Any]:
    function, shaped = getattr(guard._wrapped, member), guard._declarations[member].shaped

    def call(*arguments: Any, **named: Any) -> Any:
        value = function(*arguments, **named)
        return _checked(guard, member, value, guard._sizes(arguments[0]) if shaped and guard._sizes else {})

    return call


def _checked(guard: _Guarded, member: str, value: Any, sizes: Sizes) -> Any:
    try:
        return conform(value, guard._declarations[member].hint, sizes, guard._name)
    except WrongValueError as wrong:
        raise _error(guard, member, str(wrong)) from None


def _error(guard: _Guarded, member: str, what: str) -> UsageError:
    declared = guard._declarations[member]
    verb = "returned" if declared.is_method and "not a method" not in what else "is"
    who = f"the {WORDS.get(guard._part, 'plug-in')} {guard._name}"
    fact = f"{who} returned {what}" if member == "__call__" else f"the {member} of {who} {verb} {what}"
    room = declared.protocol.__module__.rpartition(".")[2]
    return UsageError(
        fact,
        where=f"{type(guard._wrapped).__module__}.{type(guard._wrapped).__qualname__}",
        next_step=NEXT.format(room, declared.protocol.__name__),
    )


@cache
def _declared(part: str) -> Mapping[str, Declared]:
    """The members of a protocol and of its abilities, by name."""
    declarations: dict[str, Declared] = {}
    for one in (getattr(protocols, part), *abilities.ABILITIES.get(part, ())):
        for member, value in vars(one).items():
            function = value.fget if isinstance(value, property) else value
            if (member.startswith("_") and member != "__call__") or not callable(function):
                continue
            if function.__module__ != one.__module__:  # typing's own
                continue
            try:
                hint = get_type_hints(function, include_extras=True).get("return", Any)
            except NameError:  # a type for type checkers alone
                hint = Any
            declarations[member] = Declared(hint, one, not isinstance(value, property), _is_shaped(hint))
    return declarations


def _is_shaped(hint: Any) -> bool:
    """Whether a shape stands in a type, or in a field of a dataclass that stands in it."""
    if isinstance(hint, str):
        return hint.startswith("(")
    inner = get_args(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        inner = tuple(field_type for _, field_type in _fields(hint))
    return any(_is_shaped(one) for one in inner)


def conform(value: Any, hint: Any, sizes: Sizes, name: str = "") -> Any:
    """The value, arrays as arrays and limits of plug-ins guarded. WrongValueError: it is of another type.

    hint: of `typing`. sizes: of letters in shapes. name: of a limit's owner.
    """
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, typing.TypeVar):
        return value
    if origin is Annotated:
        return _annotated(value, inner[0], inner[1:], sizes, name)
    if origin in (Union, types.UnionType):
        return _one_of(value, inner, sizes, name)
    if origin is Literal:
        return _require(value, value in inner, f"not one of {', '.join(map(str, inner))}")
    if origin is np.ndarray:
        return _array(value, inner)
    if origin is type or hint is type:
        return _require(value, isinstance(value, type), "not a class")
    if origin is collections.abc.Callable:
        return _require(value, callable(value), "not callable")
    if origin is tuple or (isinstance(origin, type) and issubclass(origin, collections.abc.Sequence)):
        return _sequence(value, origin, inner, sizes, name)
    if isinstance(origin, type) and issubclass(origin, collections.abc.Mapping):
        return _mapping(value, inner, sizes, name)
    return _single(value, hint, sizes, name)


def _annotated(value: Any, hint: Any, notes: Sequence[Any], sizes: Sizes, name: str) -> Any:
    """By its type, and then by what stands beside that."""
    value = conform(value, hint, sizes, name)
    for note in notes:
        if isinstance(note, type):
            _has_members(value, note)
        elif note == NOT_EMPTY:
            _require(value, len(value) > 0, "nothing: at least one is needed")
        elif note.startswith(KEYS):
            missing = [key for key in note.removeprefix(KEYS).split(", ") if key not in value]
            _require(value, not missing, f"without {', '.join(missing)}")
        elif note.startswith("("):
            _of_shape(value, note, sizes)
            _require(value, "NaN" in notes or bool(np.isfinite(value).all()), "not finite")
    return value


def _of_shape(value: Any, shape: str, sizes: Sizes) -> None:
    letters = [letter.strip() for letter in shape.strip("()").split(",") if letter.strip()]
    expected = [int(letter) if letter.isdigit() else sizes.get(letter) for letter in letters]
    actual = np.shape(value)
    fits = len(actual) == len(expected) and all(w in (None, n) for w, n in zip(expected, actual, strict=True))
    known_sizes = "".join(f", {letter} = {sizes[letter]}" for letter in letters if letter in sizes)
    _require(value, fits, f"not of shape {shape}{known_sizes}")


def _one_of(value: Any, hints: Sequence[Any], sizes: Sizes, name: str) -> Any:
    problems = []
    for hint in hints:
        try:
            return conform(value, hint, sizes, name)
        except WrongValueError as wrong:
            problems.append(wrong)
    raise problems[0]


def _array(value: Any, inner: Sequence[Any]) -> Any:
    """As NumPy has it; numbers in lists become an array."""
    (dtype,) = get_args(inner[1]) or (np.float64,)
    if isinstance(value, list | tuple | np.ndarray | np.number):
        with contextlib.suppress(ValueError):  # rows of several lengths
            array = np.asarray(value)
            if array.dtype.kind in "iufb":
                return value if array is value else array.astype(dtype)
    raise WrongValueError(f"{_as_text(value)}, not an array of numbers")


def _sequence(value: Any, origin: type, inner: Sequence[Any], sizes: Sizes, name: str) -> Any:
    kind = tuple if origin is tuple else collections.abc.Sequence
    is_sequence = isinstance(value, kind | list) and not isinstance(value, str | bytes)
    _require(value, is_sequence, f"not a {kind.__name__.lower()}")
    many = origin is not tuple or (len(inner) == 2 and inner[1] is Ellipsis)
    hints = [inner[0]] * len(value) if many else list(inner)
    _require(value, len(hints) == len(value), f"not {len(hints)} values")
    items = [
        _inside(one, hint, sizes, name, i) for i, (one, hint) in enumerate(zip(value, hints, strict=True))
    ]
    same = all(a is b for a, b in zip(items, value, strict=True))
    return value if same else tuple(items)


def _mapping(value: Any, inner: Sequence[Any], sizes: Sizes, name: str) -> Any:
    _require(value, isinstance(value, collections.abc.Mapping), "not a mapping")
    entries = {}
    for key, one in value.items():
        conform(key, inner[0], sizes, name)
        entries[key] = _inside(one, inner[1], sizes, name, key)
    return value if all(entries[key] is one for key, one in value.items()) else entries


def _inside(value: Any, hint: Any, sizes: Sizes, name: str, key: Any) -> Any:
    try:
        return conform(value, hint, sizes, name)
    except WrongValueError as wrong:
        raise WrongValueError(f"{wrong} (at {_as_text(key)})") from None


def _single(value: Any, hint: Any, sizes: Sizes, name: str) -> Any:
    """Of a plain class: a number, a text, one of our dataclasses, or a protocol's members."""
    if hint is None or hint is type(None):
        return _require(value, value is None, "not None")
    if not isinstance(hint, type):
        return value
    if getattr(hint, "_is_protocol", False):
        _has_members(value, hint)
        limit = hint.__name__ == "Limit" and not is_own(value)
        return guarded(value, "Limit", name) if limit and not isinstance(value, _Guarded) else value
    if hint is bool or hint is int or hint is float:
        no_flag = hint is bool or not isinstance(value, bool)
        return _require(value, isinstance(value, NUMBERS[hint]) and no_flag, f"not {_type_text(hint)}")
    _require(value, isinstance(value, hint), f"not {_type_text(hint)}")
    if dataclasses.is_dataclass(hint):
        for field, field_type in _fields(hint):
            try:
                conform(getattr(value, field), field_type, sizes, name)
            except WrongValueError as wrong:
                raise WrongValueError(f"{_type_text(hint)} whose {field} is {wrong}") from None
    return value


@cache
def _fields(kind: type) -> Sequence[tuple[str, Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return [(field.name, hints[field.name]) for field in dataclasses.fields(kind)]


def is_own(value: Any) -> bool:
    """Whether a package that comes with Étude made its type: the tests hold those against the protocols."""
    named = value if isinstance(value, types.FunctionType | type) else type(value)
    return named.__module__.partition(".")[0] in OWN


def _has_members(value: Any, protocol: type) -> None:
    missing = [member for member in members(protocol) if not hasattr(value, member)]
    if missing:
        raise WrongValueError(f"{_as_text(value)}, without the {', '.join(missing)} of a {protocol.__name__}")


def _require(value: Any, holds: bool, fault: str) -> Any:
    if not holds:
        raise WrongValueError(f"{_as_text(value)}, {fault}")
    return value


def _type_text(kind: type) -> str:
    return {bool: "True or False", int: "a whole number", float: "a number", str: "a text"}.get(
        kind, f"a {kind.__name__}"
    )


def _as_text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    text = " ".join(repr(value).split())
    plain = value is None or isinstance(value, str | bool | int | float | dict | list | tuple)
    if not plain:
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= TEXT else f"{text[:TEXT]}..."


def sizes_of(kind: Any) -> Callable[[Any], Sizes]:
    """k and J of a kind's robots, by what its channels say."""

    def sizes(spec: Any) -> Iterator[tuple[str, int]]:
        for channel in kind.channels(spec):
            if channel.name == kind.path:
                yield "k", len(channel.parts)
            if channel.role == "command":
                yield "J", len(channel.parts)

    return lambda spec: dict(sizes(spec))
