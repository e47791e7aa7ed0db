"""The walls between the packages: who may import whom, and what deploy/ and the command line promise.

jobs  ──►  storage  ◄──  player
"""

from __future__ import annotations

import ast
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import click
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("jobs", "player", "storage")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def name_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path):
    """Every module that a file imports, anywhere in it, by absolute name."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


IMPORTS = {name_of(path): imports_of(path) for path in MODULES}


def imports_any(module, names):
    return sorted(
        found for found in IMPORTS[module] if any(found == name or found.startswith(f"{name}.") for name in names)
    )


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [("player", ["jobs"]), ("jobs", ["player"]), ("storage", ["jobs", "player"]), ("storage", ["trimesh", "moderngl"])],
)
def test_who_never_imports_whom(package, forbidden):
    for module in IMPORTS:
        if module.split(".")[0] == package:
            assert imports_any(module, forbidden) == [], module


def test_one_module_knows_ray():
    assert [module for module in IMPORTS if imports_any(module, ["ray"])] == ["jobs.running.ray_executor"]


def test_kernels_know_neither_files_nor_ray():
    """Files with compiled functions import nothing that reads, writes or schedules; each other they may."""
    compiled = [name_of(path) for path in MODULES if "kernel(" in path.read_text()]
    allowed = ("storage.base.errors", "storage.model.tables", "storage.base.kernels", *compiled)
    for module in compiled:
        if module != "storage.base.kernels":
            own = imports_any(module, ["storage", "ray", "jobs.running.tasks", "jobs.pipeline", "pathlib"])
            assert [found for found in own if found != "storage" and not found.startswith(allowed)] == [], module


def test_one_module_says_how_kernels_are_compiled():
    assert [module for module in IMPORTS if imports_any(module, ["numba"])] == ["storage.base.kernels"]


def test_keys_of_tasks_know_all_code_that_decides_a_result():
    """Whatever a stage's modules import belongs to its code too: changed code must never meet old results.

    Stages' files name each other as modules, for their tasks; what reads a result of another is imported by its name.
    """
    from jobs.pipeline import STAGES
    from jobs.stages.support import code

    def within(module, names):
        return any(module == name or module.startswith(f"{name}.") for name in names)

    files = {file.__name__ for file in STAGES}
    words = {name_of(path) for path in MODULES if not ast.parse(path.read_text()).body[1:]}  # no code in them
    read = {name_of(path): modules_that_names_come_from(path) for path in MODULES}
    for stage in (file.STAGE for file in STAGES):
        known = (*stage.code, *stage.apart, *code.APART)
        assert within(stage.function.partition(":")[0], stage.code), stage.name
        for name in known:
            assert name in IMPORTS, f"{stage.name}: there is no {name}"
        for module, imported in IMPORTS.items():
            if within(module, stage.code):
                for found in imported & IMPORTS.keys() - words - (files - read[module]) - set(PACKAGES):
                    assert within(found, known), f"{stage.name}: {module} imports {found}"


def modules_that_names_come_from(path):
    return {node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)}


def top_level_imports(path):
    tree = ast.parse(path.read_text())
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


@pytest.mark.parametrize(
    "module", ["jobs/commands.py", "storage/cli/command.py", "player/commands.py", "jobs/running/tasks.py"]
)
def test_light_modules_import_heavy_ones_late(module):
    heavy = {"numba", "trimesh", "ray", "moderngl", "moderngl_window", "scipy", "embreex"}
    assert heavy.isdisjoint(top_level_imports(ROOT / module))


def test_help_comes_at_once():
    command = [sys.executable, "-c", "from storage.cli.command import main; main()", "--help"]
    subprocess.run(command, check=True, capture_output=True)
    took = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        took.append(time.perf_counter() - began)
    # About 0.2 s on an idle machine; the rest is room for a busy one.
    assert min(took) < 1.5
    said = "import storage.cli.command, sys; print(*sorted(m for m in sys.modules if '.' not in m))"
    loaded = subprocess.run([sys.executable, "-c", said], check=True, capture_output=True, text=True).stdout.split()
    assert {"numba", "ray", "trimesh", "moderngl", "scipy"}.isdisjoint(loaded)


def commands():
    from storage.cli.command import vlod

    context = click.Context(vlod)
    for name in vlod.list_commands(context):
        command = vlod.get_command(context, name)
        assert command is not None
        yield name, command


def test_every_command_and_option_is_explained():
    for name, command in commands():
        assert command.help, name
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, f"{name} {parameter.opts}"


def test_every_commands_help_shows_an_example():
    for name, command in commands():
        text = command.get_help(click.Context(command, info_name=f"vlod {name}"))
        assert f"vlod {name}" in text.split("\n", 1)[1], name


def test_constraints_name_versions_and_nothing_else():
    """No addresses, no paths, no local builds: `name==version`, each once, and all that pyproject asks for."""
    lines = (ROOT / "deploy" / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    names = []
    for pin in pins:
        name, equals, version = pin.partition("==")
        assert equals, pin
        assert name.replace("-", "").isalnum(), pin
        assert name == name.lower(), pin
        assert version.replace(".", "").isalnum(), pin
        names.append(name)
    assert names == sorted(set(names))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + [need for extra in project["optional-dependencies"].values() for need in extra]
    for need in wanted:
        assert need.split(">=")[0] in names, need


def test_nothing_points_at_an_address_to_install_from():
    for path in [ROOT / "pyproject.toml", *sorted((ROOT / "deploy").iterdir()), ROOT / ".ci" / "run"]:
        text = path.read_text()
        for word in ("://", "--index-url", "--extra-index-url", "--find-links", "git+"):
            assert word not in text, f"{path.name}: {word}"


@pytest.mark.parametrize("script", ["setup.sh", "demo.sh", "test.sh"])
def test_shell_scripts_parse(script):
    subprocess.run(["sh", "-n", str(ROOT / "deploy" / script)], check=True)
