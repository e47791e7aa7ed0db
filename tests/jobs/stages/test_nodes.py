"""Fragments of the tree: what their tasks are keyed by, and that the way the tree is parted changes nothing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jobs.objects.fragments import Fragment
from jobs.scenes import write_scene
from jobs.stages import nodes, pieces
from jobs.stages.nodes import chunks_of_fragments
from tests.jobs.built_geometry import build_geometry


def test_a_fragment_uses_the_chunks_of_its_own_leaves() -> None:
    # node 0 over leaf 1 and node 2; node 2, a fragment of its own, over leaves 3 and 4
    shapes = SimpleNamespace(
        end=np.array([5, 2, 5, 4, 5]),
        leaf=np.array([-1, 1, -1, 0, 2]),
        members=np.array([0, 1, 2, 3]),
        start=np.array([0, 1, 3, 4]),
        placed={"piece": np.array([5, 0, 9, 4])},
        chunk_start=np.array([0, 4, 8, 10]),
    )
    fragments = [Fragment(2, [], 10), Fragment(0, [2], 10)]
    assert chunks_of_fragments(shapes, fragments) == {2: [1], 0: [0, 2]}


def test_how_the_work_is_parted_changes_no_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_scene("plant", tmp_path / "scene.glb", 20_000, 0)
    whole = build_geometry([tmp_path / "scene.glb"], tmp_path / "whole")
    monkeypatch.setattr(pieces, "TRIANGLES", 2000)
    monkeypatch.setattr(nodes, "TRIANGLES", 2000)
    parted = build_geometry([tmp_path / "scene.glb"], tmp_path / "parted")
    tasks = {report.name: report.run for report in parted.run.reports}
    assert tasks["pieces"] > 5
    assert tasks["nodes"] > 5
    for name in ("node", "level", "triangles", "error", "lo", "hi"):
        assert (whole.geometry.drawables[name] == parted.geometry.drawables[name]).all()
