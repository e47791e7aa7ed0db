"""Payloads become JSON and come back as they were."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import pytest

from jobs.running.as_json import from_json, to_json


@dataclass(frozen=True)
class Inner:
    number: float
    name: str | None = None


@dataclass(frozen=True)
class Outer:
    pair: tuple[int, float]
    many: tuple[Inner, ...]
    inner: Inner = field(default_factory=lambda: Inner(2.5))
    flag: bool = False
    maybe: tuple[str, int] | None = None


@pytest.mark.parametrize(
    "value",
    [
        Outer((1, 0.5), ()),
        Outer((1, 0.5), (Inner(1.0, "a"), Inner(2.0)), Inner(3.0, None), True, ("b", 4)),
    ],
)
def test_what_comes_back_is_equal(value):
    assert from_json(Outer, json.loads(json.dumps(to_json(value)))) == value
    assert from_json(Outer, to_json(value)) == value


def test_a_name_that_is_not_known_is_an_error():
    with pytest.raises(TypeError, match="nmae"):
        from_json(Inner, {"number": 1.0, "nmae": "a"})
    with pytest.raises(TypeError, match="number"):
        from_json(Inner, {})


def test_a_tuple_of_another_length_is_an_error():
    with pytest.raises(ValueError, match="zip"):
        from_json(Outer, {"pair": [1, 2, 3], "many": []})
