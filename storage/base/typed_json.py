"""Dataclasses as JSON and back, by the types of their fields: what a file says has names, and is checked at one place.

Fields may be str, int, float, bool, Any, mappings from str, tuples of one type or of a given length, other dataclasses,
and any of these or None.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")

#: Makes a value of JSON's.
_Read = Callable[[Any], Any]


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
    read: _Read = _reader(typing.cast(Any, kind))
    try:
        return typing.cast(T, read(value))
    except _MisfitError as error:
        raise ValueError(f"{place}{''.join(reversed(error.places))} {error}") from None


class _MisfitError(Exception):
    """A value does not fit its type; `places` says where, the innermost first."""

    def __init__(self, what: str) -> None:
        super().__init__(what)
        self.places: list[str] = []


@functools.cache
def _reader(kind: Any) -> _Read:
    """What reads values of a type."""
    if kind is Any:
        return lambda value: value
    if dataclasses.is_dataclass(kind):
        return _reader_of_fields(kind)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        (read,) = (_reader(one) for one in inner if one is not type(None))
        return lambda value: None if value is None else read(value)
    if origin is tuple:
        return _reader_of_list(inner)
    if origin is not None:
        return _reader_of_mapping(_reader(inner[1]))

    def read_plain(value: Any) -> Any:
        if type(value) is kind:
            return value
        if kind is float and type(value) is int:
            return float(value)
        raise _MisfitError(f"is {value!r:.50}, not of type {kind.__name__}")

    return read_plain


def _reader_of_fields(kind: Any) -> _Read:
    hints, absent = typing.get_type_hints(kind), dataclasses.MISSING
    fields = [
        (field.name, _reader(hints[field.name]), field.default is absent and field.default_factory is absent)
        for field in dataclasses.fields(kind)
    ]

    def read(value: Any) -> Any:
        if not isinstance(value, dict):
            raise _MisfitError("is no object")
        found = {}
        for name, read_field, needed in fields:
            if name in value:
                try:
                    found[name] = read_field(value[name])
                except _MisfitError as error:
                    error.places.append(f".{name}")
                    raise
            elif needed:
                raise _MisfitError(f"has no {name}")
        return kind(**found)

    return read


def _reader_of_list(inner: tuple[Any, ...]) -> _Read:
    one_kind = inner[1:] == (...,)
    readers = [_reader(kind) for kind in (inner[:1] if one_kind else inner)]

    def read(value: Any) -> Any:
        if not isinstance(value, list):
            raise _MisfitError("is no list")
        if not one_kind and len(readers) != len(value):
            raise _MisfitError(f"has {len(value)} values, not {len(readers)}")
        found = []
        try:
            for at, item in enumerate(value):
                found.append(readers[0 if one_kind else at](item))
        except _MisfitError as error:
            error.places.append(f"[{len(found)}]")
            raise
        return tuple(found)

    return read


def _reader_of_mapping(read_item: _Read) -> _Read:
    def read(value: Any) -> Any:
        if not isinstance(value, dict):
            raise _MisfitError("is no object")
        found = {}
        for key, item in value.items():
            try:
                found[key] = read_item(item)
            except _MisfitError as error:
                error.places.append(f".{key}")
                raise
        return found

    return read
