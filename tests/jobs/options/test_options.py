"""Options and the parameters that they set belong together, group by group."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import click
import pytest

from jobs.commands import build
from jobs.options import objects, running
from jobs.options.groups import GROUPS, SECTIONS
from jobs.parameters import BuildParameters
from storage.base.errors import ParameterError
from storage.cells.codecs import DEFAULT


@pytest.mark.parametrize(
    ("section", "group"), list(zip(SECTIONS, GROUPS, strict=True)), ids=[each.title for each in SECTIONS]
)
def test_a_group_has_an_option_for_each_of_its_parameters(section, group):
    options = {option.name for option in section.options}
    assert options - {"objects"} == {field.name for field in dataclasses.fields(group)}


def test_options_that_are_not_given_are_the_parameters_that_are_not_given():
    given = build.make_context("build", ["model.glb", "model.store"]).params
    names = {"objects", *(field.name for field in dataclasses.fields(BuildParameters))}
    options = objects.filled_in({name: value for name, value in given.items() if name in names})
    assert BuildParameters(**options) == BuildParameters()


def test_all_groups_are_in_the_command_and_in_the_parameters():
    own = {option.name for section in (*SECTIONS, running.SECTION) for option in section.options}
    assert {param.name for param in build.params if isinstance(param, click.Option)} == own
    assert {field.name for field in dataclasses.fields(BuildParameters)} == {
        field.name for group in GROUPS for field in dataclasses.fields(group)
    }
    assert BuildParameters().codec == DEFAULT


def test_objects_that_are_named_are_the_parameters_of_that_name():
    given = {option.name: None for option in objects.SECTION.options}
    for name, numbers in objects.OBJECTS.items():
        filled = objects.filled_in({**given, "objects": name, "object_size": 0.5})
        assert filled["object_size"] == 0.5
        assert filled["cluster_volume"] == numbers["cluster_volume"]
        assert "objects" not in filled
    defaults = {field.name: field.default for field in dataclasses.fields(objects.ObjectParameters)}
    assert objects.OBJECTS["balanced"].items() <= defaults.items()


def test_every_group_is_checked():
    wrong = [
        {"region": (1, 1, 1, 0, 2, 2)},
        {"max_depth": -1},
        {"quality": "best"},
        {"pixel_error": 0.0},
        {"object_ratio": 0.5},
        {"up": "w"},
        {"codec": "morse"},
    ]
    assert len(wrong) == len(GROUPS)
    for options, group in zip(wrong, GROUPS, strict=True):
        assert options.keys() <= {field.name for field in dataclasses.fields(group)}
        with pytest.raises(ParameterError):
            BuildParameters(**options)


def test_help_has_a_section_for_each_group_and_needs_nothing_heavy():
    said = (
        "import sys; from jobs.commands import build; import click; "
        "print(build.get_help(click.Context(build, info_name='vlod build'))); "
        "print('loaded', *sorted({m.split('.')[0] for m in sys.modules}))"
    )
    text = subprocess.run([sys.executable, "-c", said], check=True, capture_output=True, text=True).stdout
    lines = text.splitlines()
    sections = [line[:-1] for line in lines if line.endswith(":") and not line.startswith((" ", "Usage"))]
    assert sections == [section.title for section in (*SECTIONS, running.SECTION)] + ["Other"]
    assert "--help" in text
    assert {"numpy", "numba", "ray"}.isdisjoint(lines[-1].split())
