"""Dataclasses as JSON and back, by the types of their fields: what a file says has names, and is checked at one place.

Fields may be str, int, float, bool, Any, mappings from str, tuples of one type or of a given length, other dataclasses,
and any of these or None.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def to_json(value: Any) -> Any:
    """A dataclass as an object of its fields, all in it likewise; tuples become lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    return value


def from_json(kind: type[T], value: Any, place: str) -> T:
    """The dataclass of type `kind` that `to_json` made `value` of; keys that it has no field for are ignored.

    place: what `value` is, for errors. Raises ValueError, which names the place inside, for what is missing or of
    another type.
    """
    return typing.cast(T, _read(kind, value, place))


def _read(kind: Any, value: Any, place: str) -> Any:
    if kind is Any:
        return value
    if dataclasses.is_dataclass(kind):
        return _read_fields(kind, value, place)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if value is None and type(None) in inner:
            return None
        (kind,) = (one for one in inner if one is not type(None))
        return _read(kind, value, place)
    if origin is tuple:
        return _read_tuple(inner, value, place)
    if origin is not None:
        if not isinstance(value, dict):
            raise ValueError(f"{place} is no object")
        return {key: _read(inner[1], item, f"{place}.{key}") for key, item in value.items()}
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"{place} is {value!r:.50}, not of type {kind.__name__}")
    return value


def _read_fields(kind: Any, value: Any, place: str) -> Any:
    if not isinstance(value, dict):
        raise ValueError(f"{place} is no object")
    found = {}
    for name, (inner, needed) in _fields(kind).items():
        if name in value:
            found[name] = _read(inner, value[name], f"{place}.{name}")
        elif needed:
            raise ValueError(f"{place} has no {name}")
    return kind(**found)


def _read_tuple(inner: tuple[Any, ...], value: Any, place: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{place} is no list")
    kinds = [inner[0]] * len(value) if inner[1:] == (...,) else list(inner)
    if len(kinds) != len(value):
        raise ValueError(f"{place} has {len(value)} values, not {len(kinds)}")
    return tuple(_read(kind, item, f"{place}[{at}]") for at, (kind, item) in enumerate(zip(kinds, value, strict=True)))


@functools.cache
def _fields(kind: Any) -> dict[str, tuple[Any, bool]]:
    """The type of each of a dataclass's fields, and whether it must be there."""
    hints = typing.get_type_hints(kind)
    absent = dataclasses.MISSING
    return {
        field.name: (hints[field.name], field.default is absent and field.default_factory is absent)
        for field in dataclasses.fields(kind)
    }
