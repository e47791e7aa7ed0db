import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import pytest

from storage.base.typed_json import from_json, to_json


@dataclass(frozen=True)
class Inner:
    name: str
    size: int


@dataclass(frozen=True)
class Further(Inner):
    share: float


@dataclass(frozen=True)
class Outer:
    place: tuple[float, float]
    inner: Inner
    many: tuple[Further, ...]
    by_name: Mapping[str, Inner]
    anything: Any
    perhaps: Inner | None = None
    flag: bool = False


OUTER = Outer((0.5, 2.0), Inner("a", 1), (Further("b", 2, 0.5),), {"c": Inner("c", 3)}, [1, {"x": None}])


@pytest.mark.parametrize("value", [OUTER, replace(OUTER, perhaps=Inner("d", 4), many=(), flag=True)])
def test_what_was_written_comes_back(value: Outer) -> None:
    assert from_json(Outer, json.loads(json.dumps(to_json(value))), "it") == value


def test_what_is_not_known_is_ignored_and_what_has_a_default_may_be_absent() -> None:
    content = to_json(OUTER)
    del content["perhaps"], content["flag"]
    content["inner"]["later"] = 1
    assert from_json(Outer, content, "it") == OUTER


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"place": [1.0]}, r"it.place has 1 values, not 2"),
        ({"place": [1, "2"]}, r"it.place\[1\] is '2', not of type float"),
        ({"place": [1, True]}, r"it.place\[1\] is True, not of type float"),
        ({"inner": {"name": "a"}}, r"it.inner has no size"),
        ({"inner": {"name": "a", "size": True}}, r"it.inner.size is True, not of type int"),
        ({"inner": None}, r"it.inner is no object"),
        ({"many": {}}, r"it.many is no list"),
        ({"many": [{"name": "b", "size": 1.0, "share": 1}]}, r"it.many\[0\].size is 1.0, not of type int"),
        ({"by_name": {"c": []}}, r"it.by_name.c is no object"),
        ({"by_name": []}, r"it.by_name is no object"),
        ({"perhaps": 1}, r"it.perhaps is no object"),
        ({"flag": 1}, r"it.flag is 1, not of type bool"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        from_json(Outer, {**to_json(OUTER), **changes}, "it")


def test_whole_numbers_are_numbers() -> None:
    found = from_json(Outer, {**to_json(OUTER), "place": [1, 2]}, "it")
    assert found.place == (1.0, 2.0)
    assert all(type(value) is float for value in found.place)
