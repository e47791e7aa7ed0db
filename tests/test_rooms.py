"""Rooms and modules of a package build on each other one way: no circle of imports, at any depth of the tree."""

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


@pytest.mark.parametrize("package", PACKAGES)
def test_no_circle_of_imports(package: str) -> None:
    try:
        TopologicalSorter(builds_on(package)).prepare()
    except CycleError as error:
        pytest.fail(f"{package}: each of these imports the one before it: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("package", IN_ORDER)
def test_what_is_read_first_is_built_on(package: str) -> None:
    told = ast.get_docstring(ast.parse((folder_of(package) / "__init__.py").read_text())) or ""
    order = re.findall(r"^ {4}(\w+)/? {2,}\S", told, re.MULTILINE)
    assert sorted(order) == members(package)
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
