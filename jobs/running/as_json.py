"""Dataclasses as JSON and back: how payloads travel to workers, and what keys of tasks are made of."""

from __future__ import annotations

import dataclasses
import types
import typing
from typing import Any, TypeVar

T = TypeVar("T")


def to_json(value: Any) -> dict[str, Any]:
    """A dataclass by the names of its fields, all the way down. Its values are what JSON holds, tuples among them."""
    return dataclasses.asdict(value)


def from_json(kind: type[T], value: Any) -> T:
    """The value of a kind that JSON tells of: a dataclass, or what the fields of dataclasses are annotated with.

    Lists become tuples where the annotation says so. Raises TypeError for names that the dataclass does not have.
    """
    found: Any = value
    inner = typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        fields = {name: from_json(hints.get(name, object), part) for name, part in value.items()}
        found = kind(**fields)
    elif typing.get_origin(kind) is types.UnionType:  # X | None
        found = None if value is None else from_json(inner[0], value)
    elif typing.get_origin(kind) is tuple:
        kinds = [inner[0]] * len(value) if inner[1:] == (...,) else inner
        found = tuple(from_json(each, part) for each, part in zip(kinds, value, strict=True))
    return typing.cast(T, found)
