"""Rooms: each says what lies in it and is no heap, and they build on each other one way, at any depth of the tree."""

from __future__ import annotations

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = sorted(
    ".".join(file.parent.relative_to(ROOT).parts)
    for top in ("storage", "jobs", "player")
    for file in (ROOT / top).rglob("__init__.py")
)
#: Where the order of reading is the order of building: each line of `__init__` stands on those above it alone.
IN_ORDER = [name for name in PACKAGES if re.match(r"jobs\.(visibility|detail)\b", name)]


#: Files beside each other in one room, `__init__` left out: as many as a newcomer takes in at a look.
FILES_IN_A_ROOM = 11


def folder_of(package: str) -> Path:
    return ROOT.joinpath(*package.split("."))


def members(package: str) -> list[str]:
    """The rooms and modules right inside a package, by name."""
    inside = folder_of(package).iterdir()
    return sorted(
        path.stem
        for path in inside
        if (path.suffix == ".py" and path.stem != "__init__") or (path / "__init__.py").exists()
    )


def imported(file: Path) -> set[str]:
    """Dotted names that a file imports, at its top and inside of functions; what is imported of a module, too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def builds_on(package: str) -> dict[str, set[str]]:
    """For each member of a package, the other members that it imports."""
    known, needs = set(members(package)), {}
    for name in known:
        path = folder_of(package) / name
        files = sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
        found = {other for file in files for other in imported(file) if other.startswith(package + ".")}
        needs[name] = ({other.removeprefix(package + ".").split(".")[0] for other in found} & known) - {name}
    return needs


def order_of(package: str) -> list[str]:
    """What a package's `__init__` lists, in its order: modules, and the rooms in it with a slash behind."""
    told = ast.get_docstring(ast.parse((folder_of(package) / "__init__.py").read_text())) or ""
    return re.findall(r"^ {4}(\w+/?) {2,}\S", told, re.MULTILINE)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_says_what_lies_in_it(package: str) -> None:
    there = [name + ("/" if (folder_of(package) / name).is_dir() else "") for name in members(package)]
    assert sorted(order_of(package)) == sorted(there)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_room_is_a_heap(package: str) -> None:
    assert len([name for name in members(package) if not (folder_of(package) / name).is_dir()]) <= FILES_IN_A_ROOM


@pytest.mark.parametrize("package", PACKAGES)
def test_no_circle_of_imports(package: str) -> None:
    try:
        TopologicalSorter(builds_on(package)).prepare()
    except CycleError as error:
        pytest.fail(f"{package}: each of these imports the one before it: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("package", IN_ORDER)
def test_what_is_read_first_is_built_on(package: str) -> None:
    order = [name.removesuffix("/") for name in order_of(package)]
    needs = builds_on(package)
    for place, name in enumerate(order):
        assert needs[name] <= set(order[:place]), f"{package}: {name} stands above what it imports"


def test_a_circle_would_be_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name, text in {"a/one.py": "import p.b.two", "b/two.py": "from p.a import one", "b/three.py": ""}.items():
        file = tmp_path / "p" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        (file.parent / "__init__.py").touch()
        file.write_text(text)
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    assert builds_on("p") == {"a": {"b"}, "b": {"a"}}
    with pytest.raises(pytest.fail.Exception, match="p: each of these"):
        test_no_circle_of_imports("p")
