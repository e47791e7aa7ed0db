"""The hierarchy of a whole model: certified errors, monotone, nothing lost, nothing torn."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.importing.model import MeshView, Part, write_model
from jobs.scenes import write_scene
from storage.model.cut import cut_within
from storage.model.tree import leaves, parents
from tests.jobs.built_geometry import Built, Originals, build_geometry, build_levels, mesh_of
from tests.jobs.detail.sampling import distances, sample


@pytest.fixture(scope="module", params=["plant", "offices"])
def built(request, tmp_path_factory) -> Built:
    folder = tmp_path_factory.mktemp(request.param)
    write_scene(request.param, folder / "scene.glb", 20_000, 0)
    return build_geometry([folder / "scene.glb"], folder / "store")


def test_measured_errors_are_below_the_stored_ones(built: Built) -> None:
    originals = Originals(built)
    rng = np.random.default_rng(2)
    for drawable, row in enumerate(built.geometry.drawables):
        surface, mesh = originals.of(int(row["node"])), mesh_of(built.geometry, drawable)
        rounding = 1e-12 * np.abs(surface[0]).max()
        assert distances(sample(*surface, 30, rng), *mesh).max() <= row["error"] + rounding
        assert distances(sample(*mesh, 30, rng), *surface).max() <= row["error"] + rounding


def test_errors_grow_up_the_tree_and_triangles_become_fewer(built: Built) -> None:
    geometry = built.geometry
    rows = geometry.drawables
    first = geometry.nodes["first_drawable"]
    above = parents(geometry.nodes)
    inner = ~leaves(geometry.nodes)
    assert inner.sum() > 10
    for node in np.flatnonzero(above >= 0):
        assert rows["error"][first[above[node]]] >= rows["error"][first[node]]
    for node in np.flatnonzero(inner):
        own = rows["triangles"][first[node] : first[node] + geometry.nodes["levels"][node]].astype(int)
        assert (np.diff(own) < 0).all()
        assert own[0] <= sum(rows["triangles"][first[child]] for child in np.flatnonzero(above == node))
    assert rows["triangles"][first[0]] < geometry.drawables["triangles"][first[~inner]].sum() / 20


def test_leaves_hold_every_face_once(built: Built) -> None:
    geometry, model = built.geometry, built.model
    held: dict[int, list[np.ndarray]] = {}
    for leaf in np.flatnonzero(leaves(geometry.nodes)).tolist():
        parts, faces = geometry.source_faces(int(geometry.nodes["first_drawable"][leaf]))
        for part in np.unique(parts).tolist():
            held.setdefault(part, []).append(faces[parts == part])
    for part, row in enumerate(model.parts):
        found = np.sort(np.concatenate(held[part]))
        assert found.tolist() == np.sort(model.mesh(int(row["mesh"])).source_faces).tolist()


def test_any_cut_stands_for_every_leaf_once(built: Built) -> None:
    geometry = built.geometry
    own = np.flatnonzero(leaves(geometry.nodes))
    sizes = []
    for error in (0.0, 0.01, 0.1, 1.0, 1e9):
        cut = cut_within(geometry.nodes, geometry.drawables, error)
        nodes = geometry.drawables["node"][cut]
        covers = (nodes[:, None] <= own) & (own < geometry.nodes["end"][nodes][:, None])
        assert (covers.sum(axis=0) == 1).all()
        sizes.append(int(geometry.drawables["triangles"][cut].sum()))
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] < sizes[0] / 20


def test_split_surfaces_have_no_crack_whatever_the_levels(tmp_path) -> None:
    """A large closed surface cut into many leaves: at any mixture of leaves' levels and inner nodes no edge is open."""
    n = 70
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(n) * 2 * np.pi / n, indexing="ij")
    ring = 3 + np.cos(v) * (1 + 0.1 * np.sin(5 * u))
    points = np.stack([ring * np.cos(u), ring * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    i = np.arange(n * n).reshape(n, n)
    a, b = i.ravel(), np.roll(i, -1, 0).ravel()
    c, d = np.roll(np.roll(i, -1, 0), -1, 1).ravel(), np.roll(i, -1, 1).ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    file = tmp_path / "torus.obj"
    file.write_text(
        "".join(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in points)
        + "".join(f"f {x} {y} {z}\n" for x, y, z in triangles + 1)
    )
    built = build_geometry([file], tmp_path / "store")
    geometry = built.geometry
    assert leaves(geometry.nodes).sum() > 4
    # up to there all levels of all nodes are known to be seen from outside only; above that, the tube is pressed flat
    # somewhere, and one of two sides suffices
    fine = geometry.drawables["error"] < 0.2
    assert fine.sum() > leaves(geometry.nodes).sum()
    assert geometry.drawables["one_sided"][fine].all()
    rng = np.random.default_rng(0)
    for _ in range(12):
        chosen: list[int] = []
        todo = [0]
        while todo:
            node = todo.pop()
            first, levels = int(geometry.nodes["first_drawable"][node]), int(geometry.nodes["levels"][node])
            rows = geometry.drawables[first : first + levels]
            usable = int((rows["error"] < 0.2).sum())
            if usable and (geometry.nodes["end"][node] == node + 1 or rng.random() < 0.3):
                chosen.append(first + int(rng.integers(usable)))
            else:
                todo += [node + 1, int(geometry.nodes["end"][node + 1])]
        surfaces = geometry.surfaces(np.array(chosen))
        _, ids = np.unique(surfaces.points, axis=0, return_inverse=True)
        corners = ids.reshape(-1)[surfaces.triangles]
        corners = corners[(corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])]
        edges = np.sort(np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
        _, counts = np.unique(edges, axis=0, return_counts=True)
        assert (counts > 1).all()


def test_instances_stay_shared_and_melt_above(tmp_path) -> None:
    rng = np.random.default_rng(1)
    u, v = np.meshgrid(np.arange(16), np.arange(1, 8))
    theta, phi = np.pi * v / 8, 2 * np.pi * u / 16
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    points = np.concatenate([ring, [[0, 0, 1], [0, 0, -1]]])
    faces = []
    for row in range(6):
        for at in range(16):
            a, b = row * 16 + at, row * 16 + (at + 1) % 16
            faces += [(a, a + 16, b + 16), (a, b + 16, b)]
    for at in range(16):
        faces += [(112, at, (at + 1) % 16), (113, 96 + (at + 1) % 16, 96 + at)]
    ball = MeshView.of(points, np.array(faces))
    spots = rng.uniform(0, 100, (60, 3))
    placements = [Part(0, f"ball {i}", np.hstack([np.eye(3), spot[:, None]])) for i, spot in enumerate(spots)]
    write_model(tmp_path / "model", [ball], placements)
    file = tmp_path / "balls.obj"
    text, count = [], 0
    for spot in spots:
        text += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points + spot]
        text += [f"f {a + count + 1} {b + count + 1} {c + count + 1}" for a, b, c in faces]
        count += len(points)
    file.write_text("\n".join(text) + "\n")
    alone = build_geometry([file], tmp_path / "alone").geometry
    assert alone.drawables["instance"].max() == -1
    shared = build_levels(tmp_path / "model", tmp_path / "shared").geometry
    own = leaves(shared.nodes)
    assert own.sum() == 60
    assert (shared.drawables["instance"][shared.nodes["first_drawable"][own]] >= 0).all()
    assert len(np.unique(shared.drawables["geometry"][shared.nodes["first_drawable"][own]])) == 1
    assert (shared.drawables["instance"][shared.nodes["first_drawable"][~own]] == -1).all()
    assert shared.geometry["triangles"].sum() < 0.6 * alone.geometry["triangles"].sum()
