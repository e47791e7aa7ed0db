"""Models that try to break the hierarchy, from a random generator alone; and what is wrong with the one above them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jobs.importing.model import MeshView, Part, write_model
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.repair import repair
from jobs.parameters import BuildParameters
from storage.model.cut import cut_within
from storage.model.tree import leaves, parents
from tests.jobs.built_geometry import Built, Originals, build_levels, mesh_of
from tests.jobs.detail.sampling import distances, sample
from tests.jobs.detail.shapes import Shape, box, grid, joined, sphere, torus

#: Triangles of a model, stored once, at most about.
LARGEST = 2_000
#: What double precision may take from coordinates as large as the model's, relative.
ROUNDING = 1e-12


class NastyModel(NamedTuple):
    """Meshes and where they are placed, and how the hierarchy above them is built."""

    meshes: list[MeshView]
    placements: list[Part]
    parameters: BuildParameters


def nasty_model(rng: np.random.Generator) -> NastyModel:
    """A model of several kinds of parts, many of them placed often, sheared, mirrored, tiny, or far away."""
    size = float(10.0 ** rng.uniform(-3, 4))
    room = LARGEST
    meshes: list[MeshView] = []
    placements: list[Part] = []
    for _ in range(int(rng.integers(1, 9))):
        points, triangles = KINDS[rng.integers(len(KINDS))](rng)
        points = points * np.exp(rng.normal(0, rng.choice([0.0, 0.3, 2.0]), 3))
        points = points * (rng.choice([0.01, 0.1, 1.0]) / max(float(np.abs(points).max()), 1e-9))
        source = SourceMesh("part", points * size, triangles.astype(np.int64), colours=_colours(rng, points))
        mesh, _ = repair(source)
        if mesh is None or len(mesh.triangles) > room:
            continue
        room -= len(mesh.triangles)
        meshes.append(mesh)
        times = int(rng.choice([1, 1, 2, 5, 15]))
        placements += [Part(len(meshes) - 1, f"part {len(meshes)}", _matrix(rng, size)) for _ in range(times)]
    if not meshes:
        return nasty_model(rng)
    if rng.random() < 0.2:  # far from the origin
        shift = rng.uniform(-1, 1, 3) * size * 10.0 ** rng.uniform(0, 6)
        for placement in placements:
            placement.matrix[:, 3] += shift
    parameters = BuildParameters(
        object_triangles=int(rng.choice([16, 100, 1000])),
        object_size=float(rng.choice([0.02, 0.05, 0.3])),
        object_ratio=float(rng.choice([1.0, 2.5, 10.0])),
        cluster_distance=float(rng.choice([0.01, 0.1, 1.0])),
        cluster_volume=float(rng.choice([0.0, 1e-5, 1e-3, 1.0])),
    )
    return NastyModel(meshes, placements, parameters)


def built_of(model: NastyModel, folder: Path) -> Built:
    """The hierarchy of a model, in an empty folder."""
    write_model(folder / "model", model.meshes, model.placements)
    return build_levels(folder / "model", folder / "store", model.parameters)


def faults(model: NastyModel, built: Built, seed: int, points: int = 20) -> list[str]:
    """What is wrong with the hierarchy of a model: nothing, or a sentence for each fault.

    Distances are measured from the meshes that are given, under their placements, in both directions, at `points`
    points and more for each drawable.
    """
    geometry, rng = built.geometry, np.random.default_rng(seed)
    rows, nodes = geometry.drawables, geometry.nodes
    found = _disorder(built)
    originals = Originals(built)
    whole = _placed(model, built)
    rounding = ROUNDING * (1.0 + float(np.abs(whole[0]).max()))
    for drawable, row in enumerate(rows):
        mesh, surface = mesh_of(geometry, drawable), originals.of(int(row["node"]))
        there = float(distances(_probes(surface, points, rng), *mesh).max())
        back = float(distances(_probes(mesh, points, rng), *surface).max())
        if max(there, back) > row["error"] + rounding:
            found.append(f"drawable {drawable} of error {row['error']} is {there} and {back} away")
    for allowed in (0.0, float(np.median(rows["error"])), float(rows["error"].max())):
        cut = cut_within(nodes, rows, allowed)
        mesh = joined([mesh_of(geometry, drawable) for drawable in cut.tolist()])
        apart = float(distances(_probes(whole, 4 * points, rng), *mesh).max())
        worst = float(rows["error"][cut].max())
        if apart > worst + rounding:
            found.append(f"the cut of error {worst} is {apart} away from the model")
    return found


def _disorder(built: Built) -> list[str]:
    """Faults of the tree: errors that do not grow, triangles that do not become fewer, faces that two leaves hold."""
    rows, nodes = built.geometry.drawables, built.geometry.nodes
    found = []
    for node, above in enumerate(parents(nodes).tolist()):
        first, count = int(nodes["first_drawable"][node]), int(nodes["levels"][node])
        own = rows[first : first + count]
        if (np.diff(own["error"]) <= 0).any() or (np.diff(own["triangles"].astype(np.int64)) >= 0).any():
            found.append(f"node {node}: errors {own['error']} of {own['triangles']} triangles")
        if above >= 0 and rows["error"][nodes["first_drawable"][above]] < own["error"][0]:
            found.append(f"node {above} is finer than {node} below it")
    held = np.concatenate(
        [
            np.stack(built.geometry.source_faces(int(nodes["first_drawable"][leaf])), axis=1)
            for leaf in np.flatnonzero(leaves(nodes)).tolist()
        ]
    )
    if len(np.unique(held, axis=0)) < len(held):
        found.append("a face is held twice")
    return found


def _probes(shape: Shape, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points of a surface (k, 3): spread over it, and the middles of some triangles and edges."""
    some = shape[0][shape[1][rng.permutation(len(shape[1]))[:count]]]
    weights = np.array([[1, 1, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]]) / np.array([[3], [2], [2], [2]])
    return np.concatenate([sample(*shape, count, rng), np.einsum("wc,tcx->twx", weights, some).reshape(-1, 3)])


def _placed(model: NastyModel, built: Built) -> Shape:
    """All triangles of a model, in the coordinates that it was imported to."""
    moved = []
    for placement in model.placements:
        mesh = model.meshes[placement.mesh]
        points = mesh.positions @ placement.matrix[:, :3].T + placement.matrix[:, 3]
        moved.append((points - built.model.origin, mesh.triangles.astype(np.int64)))
    return joined(moved)


def _matrix(rng: np.random.Generator, size: float) -> np.ndarray:
    """A placement (3, 4): turned, often scaled, sheared or mirrored, somewhere within `size`."""
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    kind = rng.integers(5)
    if kind == 0:
        turn = np.eye(3)[rng.permutation(3)]  # mirrors half of the time
    elif kind == 1:
        turn = turn * 10.0 ** rng.uniform(-3, 1)
    elif kind == 2:
        turn = turn @ np.diag(np.exp(rng.normal(0, 1.5, 3)))
    elif kind == 3:
        turn = turn @ (np.eye(3) + np.triu(rng.normal(0, 1, (3, 3)), 1))
    spot = rng.uniform(-1, 1, 3) * size * rng.choice([0.0, 0.1, 1.0])
    return np.ascontiguousarray(np.hstack([turn, spot[:, None]]))


def _colours(rng: np.random.Generator, points: np.ndarray) -> np.ndarray | None:
    """None, one colour for all, a few in patches, or a gradient."""
    kind = rng.integers(4)
    if kind == 0:
        return None
    if kind == 1:
        return np.tile(rng.integers(0, 256, 4, np.uint8), (len(points), 1))
    if kind == 2:
        return rng.integers(0, 256, (3, 4), np.uint8)[(points[:, 0] > 0).astype(int) + (points[:, 1] > 0)]
    spread = points - points.min(axis=0)
    level = spread / np.maximum(spread.max(axis=0), 1e-12) * 255
    return np.concatenate([level, np.full((len(points), 1), 255)], axis=1).astype(np.uint8)


def _ball(rng: np.random.Generator) -> Shape:
    return sphere(int(rng.integers(2, 13)), bumps=float(rng.choice([0.0, 0.05, 0.4])))


def _ring(rng: np.random.Generator) -> Shape:
    return torus(int(rng.integers(3, 40)), int(rng.integers(3, 20)), small=float(rng.choice([0.001, 0.1, 0.9])))


def _sheet(rng: np.random.Generator) -> Shape:
    """Open, flat or rough, often with holes, often with a spike."""
    n = int(rng.integers(2, 30))
    height = rng.random((n, n)) * rng.choice([0.0, 1e-6, 0.02, 1.0])
    if rng.random() < 0.3:
        height[rng.integers(n), rng.integers(n)] += rng.choice([0.5, 20.0])
    points, triangles = grid(n, height)
    return points, triangles[rng.random(len(triangles)) >= rng.choice([0.0, 0.0, 0.1, 0.5])]


def _pipe(rng: np.random.Generator) -> Shape:
    """Around a polyline with sharp turns; caps or none."""
    around, along = int(rng.integers(3, 33)), int(rng.integers(2, 12))
    path = np.cumsum(rng.normal(size=(along, 3)) * rng.choice([0.0, 0.3, 1.0], 3) + [0, 0, 1e-3], axis=0)
    angle = np.arange(around) * 2 * np.pi / around
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * rng.choice([0.01, 0.2])
    points = (path[:, None] + circle).reshape(-1, 3)
    triangles = []
    for row in range(along - 1):
        for at in range(around):
            a, b = row * around + at, row * around + (at + 1) % around
            triangles += [(a, b, b + around), (a, b + around, a + around)]
    if rng.random() < 0.5:
        last = (along - 1) * around
        triangles += [(0, at + 1, at) for at in range(1, around - 1)]
        triangles += [(last, last + at, last + at + 1) for at in range(1, around - 1)]
    return points, np.array(triangles)


def _needles(rng: np.random.Generator) -> Shape:
    """A fan of slivers: many triangles at one point, nearly without area."""
    n = int(rng.integers(4, 200))
    angle = np.sort(rng.random(n)) * rng.choice([1e-4, 1.0, 6.0])
    rim = np.stack([np.cos(angle), np.sin(angle), rng.normal(size=n) * rng.choice([0.0, 1e-5, 0.1])], axis=1)
    a = np.arange(1, n)
    return np.concatenate([[[0.0, 0.0, 0.0]], rim]), np.stack([0 * a, a, a + 1], axis=1)


def _soup(rng: np.random.Generator) -> Shape:
    """Random triangles over few points: edges of three and more, triangles through each other."""
    n = int(rng.integers(4, 40))
    return rng.normal(size=(n, 3)), rng.integers(0, n, (int(rng.integers(2, 300)), 3))


def _specks(rng: np.random.Generator) -> Shape:
    """Many small boxes that do not touch, or hardly; some are one and the same twice."""
    spots = rng.integers(-9, 10, (int(rng.integers(2, 60)), 3)) * 0.1
    half = rng.choice([0.001, 0.05], len(spots))
    return joined([box(tuple(at - h), tuple(at + h)) for at, h in zip(spots, half, strict=True)])


def _comb(rng: np.random.Generator) -> Shape:
    """Thin plates close behind each other, as in a heat exchanger."""
    n, gap = int(rng.integers(2, 40)), float(rng.choice([1e-4, 0.03]))
    return joined([box((0, 0, i * gap), (1, 1, i * gap + gap * float(rng.random()))) for i in range(n)])


def _voxels(rng: np.random.Generator) -> Shape:
    """Cubes of a lattice with the faces between them left out: edges of four faces, corners where they touch."""
    n = int(rng.integers(2, 7))
    full = np.zeros((n + 2, n + 2, n + 2), bool)
    full[1:-1, 1:-1, 1:-1] = rng.random((n, n, n)) < rng.choice([0.2, 0.5, 0.9])
    index = np.arange((n + 3) ** 3).reshape(n + 3, n + 3, n + 3)
    triangles = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        for side in (0, 1):
            step = np.eye(3, dtype=int)[axis]
            for cell in np.argwhere(full):
                if full[tuple(cell + (step if side else -step))]:
                    continue
                base = cell + step * side
                a, b, c, d = (int(index[tuple(at)]) for at in (base, base + u, base + u + v, base + v))
                triangles += [(a, b, c), (a, c, d)] if side else [(a, c, b), (a, d, c)]
    points = np.argwhere(np.ones((n + 3,) * 3, bool)).astype(float)
    return points, np.array(triangles or [(0, 1, 12)])


KINDS = (_ball, _ring, _sheet, _pipe, _needles, _soup, _specks, _comb, _voxels)
