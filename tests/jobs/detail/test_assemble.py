"""Nodes and drawables of placed pieces: what they claim holds for the very triangles that a store gives out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.detail.assemble import float32_down, float32_up, largest_stretch
from jobs.importing.model import MeshView, Part, write_model
from storage.meshes.placement import transform_points
from storage.model.tables import NO_PART
from storage.model.tree import leaves
from tests.jobs.built_geometry import build_levels

entries = st.floats(-100, 100, allow_nan=False).filter(lambda value: value == 0 or abs(value) > 1e-3)


@given(st.lists(entries, min_size=12, max_size=12))
def test_the_largest_stretch_is_a_close_upper_bound(values):
    matrix = np.array(values).reshape(1, 3, 4)
    true = np.linalg.norm(matrix[0, :, :3], 2)
    bound = largest_stretch(matrix)[0]
    assert true * (1 - 1e-12) <= bound <= true * (1 + 1e-5) + 1e-300


@given(st.floats(-1e30, 1e30, allow_nan=False))
def test_rounding_to_float32(value):
    up, down = float32_up(value), float32_down(value)
    assert up.dtype == down.dtype == np.float32
    assert float(down) <= value <= float(up)
    assert float(np.nextafter(up, np.float32(-np.inf))) < value
    assert float(np.nextafter(down, np.float32(np.inf))) > value


def sphere(subdivisions=24):
    """A closed ball of radius 1, wound outward."""
    u, v = np.meshgrid(np.arange(2 * subdivisions), np.arange(1, subdivisions))
    theta, phi = np.pi * v / subdivisions, np.pi * u / subdivisions
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    points = np.concatenate([ring, [[0, 0, 1], [0, 0, -1]]])
    n = 2 * subdivisions
    faces = []
    for row in range(subdivisions - 2):
        for at in range(n):
            a, b = row * n + at, row * n + (at + 1) % n
            faces += [(a, a + n, b + n), (a, b + n, b)]
    last = (subdivisions - 2) * n
    for at in range(n):
        faces += [(len(ring), at, (at + 1) % n), (len(ring) + 1, last + (at + 1) % n, last + at)]
    return points, np.array(faces, np.uint32)


def rotation(x, y, z):
    def turn(angle, a, b):
        m = np.eye(3)
        m[[a, a, b, b], [a, b, a, b]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        return m

    return turn(x, 1, 2) @ turn(y, 2, 0) @ turn(z, 0, 1)


MATRICES = {
    "moved": np.hstack([np.eye(3), [[5], [0], [0]]]),
    "turned and scaled": np.hstack([0.37 * rotation(0.3, 1.1, 2.0), [[-7], [3], [1]]]),
    "mirrored": np.hstack([rotation(0.5, 0.1, 0.2) @ np.diag([-1, 1, 1]), [[0], [9], [2]]]),
    "stretched": np.hstack([rotation(1, 2, 3) @ np.diag([3, 0.5, 1]), [[0], [-9], [0]]]),
    "sheared": np.hstack([np.array([[1, 0.7, 0], [0, 1, 0.2], [0, 0, 1.0]]), [[12], [2], [-3]]]),
}


@pytest.fixture(scope="module")
def placed(tmp_path_factory):
    """The geometry of a store with five instances of a ball and one ball of its own."""
    folder = tmp_path_factory.mktemp("placed")
    points, faces = sphere()
    ball = MeshView.of(points, faces)
    placements = [Part(0, name, matrix) for name, matrix in MATRICES.items()]
    alone = MeshView.of(points * 2 + [0, 0, 20], faces)
    placements.append(Part(1, "alone", np.eye(3, 4)))
    write_model(folder / "model", [ball, alone], placements)
    return build_levels(folder / "model", folder).geometry


def leaves_of(placed):
    """The nodes without any below them."""
    return np.flatnonzero(leaves(placed.nodes))


def test_every_placement_has_its_own_nodes(placed):
    own = leaves_of(placed)
    assert (placed.nodes["part"][own] != NO_PART).all()
    names = np.array(placed.part_names)[placed.nodes["part"][own]]
    assert set(names) == {*MATRICES, "alone"}
    counts = [np.count_nonzero(names == name) for name in MATRICES]
    assert len(set(counts)) == 1
    # The ball is large and has many triangles, so it is split.
    assert counts[0] > 1
    assert len(placed.instances) == len(MATRICES)
    # Instances share their meshes.
    drawables = np.isin(placed.drawables["node"], own)
    assert len(np.unique(placed.drawables["geometry"][drawables])) < drawables.sum() / 2


def test_boxes_are_those_of_the_triangles(placed):
    for number, row in enumerate(placed.drawables):
        mesh = placed.mesh(number)
        used = mesh.positions[mesh.triangles.reshape(-1)]
        assert np.array_equal(used.min(axis=0), row["lo"])
        assert np.array_equal(used.max(axis=0), row["hi"])
        node = placed.nodes[row["node"]]
        assert (node["lo"] <= row["lo"]).all()
        assert (node["hi"] >= row["hi"]).all()


def test_fronts_stay_fronts(placed):
    """A ball's normals point away from its centre under every placement, mirrors included."""
    for number, row in enumerate(placed.drawables):
        mesh = placed.mesh(number)
        if placed.nodes["part"][row["node"]] == NO_PART:
            continue
        name = placed.part_names[placed.nodes["part"][row["node"]]]
        centre = MATRICES[name][:, 3] if name != "alone" else np.array([0, 0, 20.0])
        a, b, c = (mesh.positions[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
        outward = ((a + b + c) / 3 - centre) * np.cross(b - a, c - a)
        assert (outward.sum(axis=1) > 0).mean() > 0.99


def test_errors_hold_for_every_placement(placed):
    """Each vertex of a level is within its error of the placed ball, sampled densely."""
    points, faces = sphere()
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], 60)
    samples = np.concatenate([points, (weights @ points[faces].reshape(-1, 3, 3)).reshape(-1, 3)])
    for number, row in enumerate(placed.drawables):
        if placed.nodes["part"][row["node"]] == NO_PART:
            continue
        name = placed.part_names[placed.nodes["part"][row["node"]]]
        matrix = MATRICES.get(name, np.array([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 20.0]]))
        truth = transform_points(matrix, samples)
        positions = placed.mesh(number).positions.astype(np.float64)
        for position in positions[:: max(1, len(positions) // 10)]:
            # The samples lie about 0.03 apart on the unit ball.
            assert np.linalg.norm(truth - position, axis=1).min() <= row["error"] + 0.05 * np.linalg.norm(
                matrix[:, :3], 2
            )
        if row["level"] == 0 and row["instance"] >= 0:
            assert row["error"] < 4 * placed.grid.step


def test_errors_grow_with_the_level(placed):
    for node in placed.nodes:
        first = int(node["first_drawable"])
        levels = placed.drawables[first : first + int(node["levels"])]
        assert (np.diff(levels["error"]) > 0).all()
        assert (np.diff(levels["triangles"].astype(int)) < 0).all()
