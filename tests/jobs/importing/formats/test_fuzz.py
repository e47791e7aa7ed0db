"""OBJ, MTL, PLY, OFF, STL and COLLADA damaged in every way: a model, or one clear line; never anything else."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from tests.jobs.importing.formats.test_ply_off_stl import binary_ply
from tests.jobs.importing.fuzzing import damaged, fuzz, words_swapped
from tests.jobs.importing.test_what_files_mean import CASES, grey, picture

#: Seconds for each kind of file; far more where VLOD_FUZZ says so.
SECONDS = float(os.environ.get("VLOD_FUZZ", "5"))


def files_of(kind: str) -> list[bytes]:
    """All files of a kind in the table of what files mean: one of each feature."""
    found = [(name, content) for case in CASES for name, content in case.files.items()]
    contents = [content if isinstance(content, bytes) else content.encode() for name, content in found if kind in name]
    return [content for content in contents if len(content) < 20_000]


KINDS = {
    **{f"a.{kind}": files_of(f".{kind}") for kind in ("obj", "off", "dae")},
    "text.stl": [content for content in files_of(".stl") if b"facet" in content],
    "binary.stl": [content for content in files_of(".stl") if b"facet" not in content],
    "text.ply": files_of(".ply"),
    "binary.ply": [binary_ply(order) for order in "<>"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_read_or_refused(tmp_path, name):
    def make(random: np.random.Generator) -> bytes:
        contents = KINDS[name]
        content = contents[int(random.integers(len(contents)))]
        binary = name.startswith("binary") or random.random() < 0.4
        return damaged(content, random) if binary else words_swapped(content, random)

    counts = fuzz(tmp_path, name, make, SECONDS, seed=20)
    assert counts["read"] > 10
    assert counts["refused"] > 10


@pytest.mark.slow
def test_damaged_material_libraries_are_read(tmp_path):
    libraries = files_of(".mtl")
    (tmp_path / "t.png").write_bytes(picture(0, 51, 255, 255))
    (tmp_path / "g.png").write_bytes(grey(51, 255))
    text = next(case for case in CASES if "t.png" in case.files).files["a.obj"]
    assert isinstance(text, str)

    def make(random: np.random.Generator) -> bytes:
        library = libraries[int(random.integers(len(libraries)))]
        spoiled = damaged(library, random) if random.random() < 0.3 else words_swapped(library, random)
        Path(tmp_path / "m.mtl").write_bytes(spoiled)
        return text.encode()

    counts = fuzz(tmp_path, "a.obj", make, SECONDS, seed=21, beside=("m.mtl", "t.png", "g.png"))
    assert counts["read"] > 10
