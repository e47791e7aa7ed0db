"""Every option says what it does, and what memory is allowed and needed stands in the docs as it is in the code."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from jobs import commands as jobs_commands
from jobs import plan
from jobs.importing.formats.gltf.textures import TEXTURES_KEPT
from jobs.running.memory import TASK_MEMORY
from storage.base.amounts import format_size, parse_size

MEMORY = (Path(__file__).parents[1] / "docs" / "memory.md").read_text()

OPTIONS = [
    (command.name, option)
    for command in vars(jobs_commands).values()
    if isinstance(command, click.Command)
    for option in command.params
    if isinstance(option, click.Option)
]


@pytest.mark.parametrize(("command", "option"), OPTIONS, ids=lambda value: getattr(value, "name", value))
def test_every_option_has_a_line_of_help(command, option):
    assert option.help


def test_the_docs_know_the_option_and_its_default():
    assert "`vlod build --memory SIZE`" in MEMORY
    option = next(option for command, option in OPTIONS if (command, option.name) == ("build", "memory"))
    assert parse_size(option.default) == TASK_MEMORY
    assert f"{format_size(TASK_MEMORY).replace('GiB', ' GiB')} by default" in MEMORY


@pytest.mark.parametrize(
    ("step", "numbers"),
    [
        ("pieces", [plan.PIECES_TRIANGLES, plan.PIECES_PER_TRIANGLE]),
        ("hierarchy", [plan.HIERARCHY_PER_PIECE]),
        ("shared", [plan.SHARED_PER_TRIANGLE, plan.SHARED_PER_PLACEMENT, plan.SHAPES_PER_PIECE]),
        ("nodes", [plan.NODES_TRIANGLES, plan.DETAIL_PER_TRIANGLE, plan.SHAPES_PER_PIECE]),
        ("tables", [plan.TABLES_PER_NODE]),
        ("cells", [plan.CELLS_PER_TRIANGLE, plan.CELLS_REST >> 20, plan.CELLS_SEALED_PER_TRIANGLE]),
        ("GLB, glTF", [TEXTURES_KEPT >> 20]),
        ("step", [plan.PROCESS >> 20]),
        ("import", [plan.IMPORT_PROCESS >> 20]),
    ],
)
def test_the_docs_give_the_numbers_of_the_plan(step, numbers):
    line = next(line for line in MEMORY.splitlines() if line.startswith(f"| {step} |"))
    for number in numbers:
        assert f" {number:,} " in line, (step, number)
