"""Pieces as they leave: shapes, borders, closedness, attributes, scales, determinism."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.detail.collapsing.face_normals import arc_cosine, face_normals
from jobs.detail.detail_options import DetailOptions
from jobs.detail.node import Level
from jobs.detail.pieces import make_pieces, plan_chunks
from jobs.importing.model import Part
from jobs.objects.components import outward_closed
from jobs.objects.object_options import Limits
from jobs.objects.weld import twins, weld
from storage.base.errors import ParameterError
from storage.model.tables import GRID_LIMIT
from tests.jobs.detail.shapes import Built, box, grid, joined, leaves_of, level_mesh, model_of, sphere, torus


def check_form(piece: Built) -> None:
    for number, level in enumerate(piece.levels):
        assert level.positions.dtype == np.int32
        assert level.triangles.dtype == np.uint32
        assert level.normals.dtype == np.float32
        assert level.colours.dtype == np.uint8
        assert len(level.positions) == len(level.normals) == len(level.colours)
        assert np.abs(level.positions).max() <= GRID_LIMIT
        assert np.unique(level.triangles).tolist() == list(range(len(level.positions)))
        assert np.linalg.norm(level.normals, axis=1) == pytest.approx(1, abs=1e-5)
        assert (level.source_faces is None) == (number > 0)
        _, areas = face_normals(level.positions, level.triangles.astype(np.int32))
        assert (areas > 0).all()
        assert isinstance(level.error, float)


def is_closed(positions: np.ndarray, triangles: np.ndarray) -> bool:
    ids, first = weld(positions, np.zeros(len(positions), np.int32))
    welded = ids[triangles.astype(np.int64)]
    return bool(outward_closed(positions[first], welded, twins(welded), np.array([0, len(welded)]))[0])


def test_box_has_one_level_with_hard_edges(tmp_path: Path) -> None:
    (piece,) = leaves_of(model_of(tmp_path, box()))
    check_form(piece)
    level = piece.levels[0]
    assert len(level.triangles) == 12
    assert len(level.positions) == 24  # three normals per corner
    assert sorted(np.unique(np.abs(level.normals)).tolist()) == [0, 1]
    assert level.one_sided
    assert level.error == 0
    assert level.source_faces is not None
    assert level.source_faces[:, 1].tolist() == list(range(12))


def test_thousands_of_boxes_keep_together_what_lies_together(tmp_path: Path) -> None:
    shape = joined([box((3 * i, 0, 0), (3 * i + 2, 1, 1)) for i in range(3000)])
    pieces = leaves_of(model_of(tmp_path, shape), most=600)
    taken = []
    for piece in pieces:
        faces = piece.levels[0].source_faces
        assert faces is not None
        assert len(faces) <= 600
        assert faces[:, 1].tolist() == list(range(faces[0, 1], faces[0, 1] + len(faces)))
        assert len(piece.offers[0].locks.points) == 0
        taken.extend(faces[:, 1].tolist())
    assert taken == list(range(36_000))


@pytest.mark.parametrize("inward", [False, True])
def test_closed_surfaces_stay_closed(tmp_path: Path, inward: bool) -> None:
    points, triangles = sphere(16, bumps=0.05)
    (piece,) = leaves_of(model_of(tmp_path, (points, triangles[:, ::-1] if inward else triangles)))
    check_form(piece)
    assert all(level.one_sided != inward for level in piece.levels)
    assert len(piece.levels) > 4
    if not inward:
        assert all(is_closed(level.positions, level.triangles) for level in piece.levels)


def test_open_surfaces_are_two_sided(tmp_path: Path) -> None:
    (piece,) = leaves_of(model_of(tmp_path, grid(9, np.zeros((9, 9)))))
    check_form(piece)
    assert not any(level.one_sided for level in piece.levels)


def test_cut_components_join_at_every_level(tmp_path: Path) -> None:
    """Any mixture of the pieces' levels is one closed surface without a crack."""
    pieces = leaves_of(model_of(tmp_path, torus(64, 32)), most=1100)
    assert len(pieces) == 4
    assert all(all(level.one_sided for level in p.levels) and len(p.levels) >= 3 for p in pieces)
    depth = max(len(p.levels) for p in pieces)
    for pick in [[0] * 4, [depth] * 4, [0, 1, 2, 3], [3, 0, 9, 1], [9, 0, 0, 9]]:
        chosen = [p.levels[min(k, len(p.levels) - 1)] for p, k in zip(pieces, pick, strict=True)]
        positions, triangles = joined([(level.positions, level.triangles.astype(np.int64)) for level in chosen])
        assert is_closed(positions.astype(np.int32), triangles)
    finest, coarsest = sum(len(p.levels[0].triangles) for p in pieces), sum(len(p.levels[-1].triangles) for p in pieces)
    assert coarsest < finest / 3


def test_cut_borders_keep_their_vertices_on_open_surfaces(tmp_path: Path) -> None:
    height = np.random.default_rng(3).random((40, 40)) * 0.05
    pieces = leaves_of(model_of(tmp_path, grid(40, height)), most=800)
    assert len(pieces) == 4
    at_finest = [{tuple(p) for p in piece.levels[0].positions.tolist()} for piece in pieces]
    for i, piece in enumerate(pieces):
        shared = at_finest[i] & set().union(*(own for j, own in enumerate(at_finest) if j != i))
        assert shared
        assert len(piece.levels) > 2
        for level in piece.levels:
            assert shared <= {tuple(p) for p in level.positions.tolist()}


def test_shading_has_no_seam_along_cut_borders(tmp_path: Path) -> None:
    pieces = leaves_of(model_of(tmp_path, torus(64, 32)), most=1100)
    smooth = {
        tuple(position): normal
        for piece in pieces
        for position, normal in zip(piece.levels[0].positions.tolist(), piece.levels[0].normals, strict=True)
    }
    uses = Counter(tuple(p) for piece in pieces for p in piece.levels[0].positions.tolist())
    for piece in pieces:
        for level in piece.levels[1:4]:
            border = [i for i, p in enumerate(level.positions.tolist()) if uses[tuple(p)] > 1]
            assert len(border) > 30
            at_border = np.array([smooth[tuple(level.positions[i].tolist())] for i in border])
            assert (level.normals[border] == at_border).all(axis=1).mean() > 0.9


def test_given_normals_are_kept_where_sane(tmp_path: Path) -> None:
    points, triangles = sphere(6)
    normals = points.astype(np.float32)
    normals[0] = 0
    normals[1] *= -1
    normals[2] *= 7
    (piece,) = leaves_of(model_of(tmp_path, (points, triangles), normals=normals))
    check_form(piece)
    level = piece.levels[0]
    assert np.linalg.norm(level.normals - level.positions * piece.scale, axis=1).max() < 0.1
    exact = np.linalg.norm(level.normals - level.positions * piece.scale, axis=1) < 0.005
    assert exact.sum() >= len(level.normals) - 20


def test_creases_stay_hard_and_smooth_stays_smooth(tmp_path: Path) -> None:
    """A tube of 24 sides with caps: 15 degrees between its sides are smooth, 90 degrees at its rims are not."""
    a = np.arange(24)
    b = (a + 1) % 24
    angle = a * np.pi / 12
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring, ring + np.array([0, 0, 2]), [[0, 0, 0], [0, 0, 2]]])
    side = np.concatenate([np.stack([a, b, b + 24], 1), np.stack([a, b + 24, a + 24], 1)])
    caps = np.concatenate([np.stack([0 * a + 48, b, a], 1), np.stack([0 * a + 49, a + 24, b + 24], 1)])
    (piece,) = leaves_of(model_of(tmp_path, (points, np.concatenate([side, caps]))))
    level = piece.levels[0]
    assert len(level.positions) == 4 * 24 + 2
    upright = np.abs(level.normals[:, 2])
    assert ((upright < 1e-6) | (upright > 1 - 1e-6)).all()
    sides = upright < 0.5
    outward = (level.normals[sides, :2] * level.positions[sides, :2] * piece.scale).sum(axis=1)
    assert outward == pytest.approx(1, abs=1e-5)
    (hard,) = leaves_of(model_of(tmp_path / "hard", (points, np.concatenate([side, caps]))), crease_angle=10)
    assert len(hard.levels[0].positions) == 6 * 24 + 2


def test_materials_keep_their_boundary(tmp_path: Path) -> None:
    points, triangles = grid(21, np.zeros((21, 21)))
    corners = points[triangles].reshape(-1, 3)
    left = np.repeat(corners.reshape(-1, 3, 3).mean(axis=1)[:, 0] < 0.5, 3)
    colours = np.where(left[:, None], [255, 0, 0, 255], [0, 0, 255, 255]).astype(np.uint8)
    (piece,) = leaves_of(model_of(tmp_path, (corners, np.arange(len(corners)).reshape(-1, 3)), colours=colours))
    assert len(piece.levels) > 4
    assert len(piece.levels[0].positions) == 21 * 21 + 21
    for level in piece.levels:
        assert {tuple(c) for c in level.colours.tolist()} <= {(255, 0, 0, 255), (0, 0, 255, 255)}
    for level in piece.levels[:3]:
        red = level.colours[level.triangles[:, 0], 0] == 255
        assert 0.35 < areas_of(level)[red].sum() / areas_of(level).sum() < 0.65


def areas_of(level: Level) -> np.ndarray:
    return face_normals(level.positions, level.triangles.astype(np.int32))[1]


def test_instanced_meshes_have_a_grid_that_is_fine_under_every_placement(tmp_path: Path) -> None:
    turn = np.array([[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0]], float)
    stretch = np.array([[6, 0, 0, -9], [0, 1, 0, 0], [0, 0, 1, 0]], float)
    model = model_of(
        tmp_path,
        sphere(6),
        box(),
        placements=[Part(0, "a", turn), Part(0, "b", stretch), Part(1, "c", turn)],
    )
    scales = {piece.mesh: piece.scale for piece in leaves_of(model)}
    assert scales[1] == model.grid.step  # placed once, so baked
    assert model.grid.step / 16 < scales[0] <= model.grid.step / 6
    assert np.log2(scales[0]) == np.round(np.log2(scales[0]))
    rotated = model_of(tmp_path / "r", sphere(6), placements=[Part(0, "a", turn), Part(0, "b", np.eye(3, 4))])
    assert leaves_of(rotated)[0].scale == rotated.grid.step


def test_chunks_group_meshes_in_order(tmp_path: Path) -> None:
    model = model_of(tmp_path, *[box((i, 0, 0), (i + 0.5, 1, 1)) for i in range(10)], sphere(6), box())
    chunks = plan_chunks(model, 40)
    assert chunks == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9], [10], [11]]
    pieces = np.concatenate([make_pieces(model, chunk, DetailOptions()).pieces for chunk in chunks])
    assert pieces["mesh"].tolist() == list(range(12))


@pytest.mark.parametrize(
    ("wrong", "what"), [({"triangles": 3}, "3 to"), ({"most": 500}, "to 500"), ({"ratio": 0.5}, "ratio")]
)
def test_limits_out_of_range(wrong: dict[str, Any], what: str) -> None:
    with pytest.raises(ParameterError, match=what):
        Limits(**wrong)
    with pytest.raises(ParameterError, match="crease_angle"):
        DetailOptions(crease_angle=200)


def same(a: Built, b: Built) -> bool:
    if (a.mesh, a.scale, len(a.levels)) != (b.mesh, b.scale, len(b.levels)):
        return False
    return all(
        np.array_equal(getattr(x, field.name), getattr(y, field.name))
        for x, y in zip(a.levels, b.levels, strict=True)
        for field in fields(Level)
        if getattr(x, field.name) is not None
    )


def test_same_input_same_leaves_however_meshes_are_batched(tmp_path: Path) -> None:
    shapes = sphere(12, bumps=0.1), torus(), grid(25, np.random.default_rng(0).random((25, 25)) * 0.1)
    model = model_of(tmp_path, *shapes)
    together, again = leaves_of(model, most=900), leaves_of(model, most=900)
    assert len(together) == len(again) > 3
    assert all(same(a, b) for a, b in zip(together, again, strict=True))
    options = DetailOptions(Limits(triangles=900, most=900))
    whole = make_pieces(model, [0, 1, 2], options)
    alone = [make_pieces(model, [i], options) for i in range(3)]
    assert np.array_equal(whole.faces, np.concatenate([s.faces for s in alone]))
    assert np.array_equal(whole.shading, np.concatenate([s.shading for s in alone]))
    assert np.array_equal(whole.shared_points, np.concatenate([s.shared_points for s in alone]))


def test_arc_cosine_is_close_enough() -> None:
    x = np.linspace(-1, 1, 2001)
    assert max(abs(arc_cosine(float(v)) - np.arccos(v)) for v in x) < 8e-5


def test_kernels_run_without_compilation(tmp_path: Path) -> None:
    """The same code in plain Python gives the same pieces, on an input small enough for it."""
    program = """
import sys
from pathlib import Path
from typing import Any
import numpy as np
from tests.jobs.detail.shapes import grid, model_of, leaves_of, sphere
shapes = sphere(2), grid(5, np.array([[0.01 * (i * j % 3) for i in range(5)] for j in range(5)]))
for piece in leaves_of(model_of(Path(sys.argv[1]), *shapes), most=24):
    for level in piece.levels:
        print(level.one_sided, level.error, level.positions.tolist(), level.triangles.tolist())
"""
    outputs = []
    for disabled in ("0", "1"):
        folder = tmp_path / disabled
        folder.mkdir()
        root = str(Path(__file__).parents[3])
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": root}
        run = subprocess.run(
            [sys.executable, "-W", "error", "-c", program, str(folder)],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
            cwd=root,
        )
        outputs.append(run.stdout)
    assert outputs[0] == outputs[1]
    assert len(outputs[0].splitlines()) >= 6


def test_levels_lie_where_the_shape_lies(tmp_path: Path) -> None:
    (piece,) = leaves_of(model_of(tmp_path, sphere(16)))
    for k in range(len(piece.levels)):
        points, _ = level_mesh(piece, k)
        assert np.abs(np.linalg.norm(points, axis=1) - 1).max() <= piece.levels[k].error + 1e-12
