"""A toy format for the tests: each line a triangle of nine numbers; `colour FILE` names a file with the colour of all.

The smallest reader that has everything a format can have, in one file.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from storage.meshes.placement import IDENTITY

MEMORY = 123_456_789


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    lines = whole(content).split(b"\n")[1:]
    corners = np.array([line.split() for line in lines if line and not line.startswith(b"colour")], np.float64)
    positions = corners.reshape(-1, 3)
    mesh = SourceMesh(file.stem, positions, np.arange(len(positions)).reshape(-1, 3))
    for name in named_files(file, content, resources):
        colour = np.array((resources.read(name) or b"9 9 9 9").split(), np.uint8)
        mesh.colours = np.tile(colour, (len(positions), 1))
    return SourceScene(file, [mesh], [SourceNode(0, mesh.name, IDENTITY)])


def sniff(content: Content) -> bool:
    return content.part(0, 4) == b"toy\n"


def named_files(_file: Path, content: Content, _resources: Resources) -> Iterable[str]:
    lines = whole(content).decode().split("\n")
    return [line.removeprefix("colour ") for line in lines if line.startswith("colour ")]


def memory(_file: Path, _content: Content, _resources: Resources) -> int:
    return MEMORY


FORMAT = Format((".toy", ".plaything"), read, sniff, named_files, memory)
