"""Every option says what it does, and what memory is allowed and needed stands in the docs as it is in the code."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from jobs import commands as jobs_commands
from jobs.importing.formats.gltf.textures import TEXTURES_KEPT
from jobs.running.memory import PROCESS, TASK_MEMORY
from jobs.stages import cells, hierarchy, import_model, layout, nodes, pieces, shards, shared, tables
from jobs.stages.packing import index, order, packs
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
        ("pieces", [pieces.TRIANGLES, pieces.PER_TRIANGLE]),
        ("hierarchy", [hierarchy.PER_PIECE]),
        ("shared", [shared.PER_TRIANGLE, shared.PER_PLACEMENT, hierarchy.SHAPES_PER_PIECE]),
        ("nodes", [nodes.TRIANGLES, nodes.PER_TRIANGLE, hierarchy.SHAPES_PER_PIECE]),
        ("tables", [tables.PER_NODE]),
        ("cells", [cells.PER_TRIANGLE, cells.REST >> 20, cells.SEALED_PER_TRIANGLE]),
        ("layout", [layout.PER_CELL]),
        ("shards", [shards.PER_ID, shards.PER_CELL, shards.PER_NODE]),
        ("order", [order.PER_ID, order.PER_NODE]),
        ("packs", [packs.REST >> 20, packs.PER_NODE]),
        ("index", [index.PER_NODE]),
        ("GLB, glTF", [TEXTURES_KEPT >> 20]),
        ("step", [PROCESS >> 20]),
        ("import", [import_model.PROCESS >> 20]),
    ],
)
def test_the_docs_give_the_numbers_of_the_plan(step, numbers):
    line = next(line for line in MEMORY.splitlines() if line.startswith(f"| {step} |"))
    for number in numbers:
        assert f" {number:,} " in line, (step, number)
