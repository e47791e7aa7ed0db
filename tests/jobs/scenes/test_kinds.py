"""A new scene is a file of its own and one line in the list: everything else follows."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from jobs import commands
from jobs.scenes import KINDS
from jobs.scenes.kinds import scene_kind
from jobs.scenes.things.draft import SceneKind
from tests.jobs.scenes.glb_reader import Glb

#: The kinds without the toy.
USUAL = tuple(KINDS)


@pytest.fixture
def command() -> Iterator[click.Command]:
    """`vlod demo-scene` of a vLOD with the toy's line in its list."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(KINDS, "toy", "tests.jobs.scenes.toy_scene")
        yield importlib.reload(commands).demo_scene
    importlib.reload(commands)


def test_the_command_makes_it(command: click.Command, tmp_path: Path) -> None:
    made = CliRunner().invoke(command, ["toy", str(tmp_path / "toy.glb"), "--triangles", "20000", "--json"])
    assert made.exit_code == 0, made.output
    assert Glb(tmp_path / "toy.glb").expanded_triangles() == 19_992


def test_help_names_it(command: click.Command) -> None:
    assert f"{{{'|'.join([*USUAL, 'toy'])}}}" in CliRunner().invoke(command, ["--help"]).output


def test_without_the_line_it_is_refused(tmp_path: Path) -> None:
    refused = CliRunner().invoke(commands.demo_scene, ["toy", str(tmp_path / "toy.glb")])
    assert refused.exit_code == 2
    assert f"'toy' is not one of {', '.join(map(repr, USUAL))}" in refused.output


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_its_scene(kind: str) -> None:
    assert isinstance(scene_kind(kind), SceneKind)
