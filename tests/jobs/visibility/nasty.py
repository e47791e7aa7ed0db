"""Scenes that try to make the engine miss something, from a random generator alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.oracle import Oracle, Sight, examine
from jobs.visibility.engine import Engine, EngineSettings

from .scenes import Mesh, box, rooms, sheet, soup_of

#: Half extents of cells, as parts of the scene's size.
SHAPES = ((0.02, 0.02, 0.02), (0.2, 0.02, 0.002), (0.003, 0.003, 0.3), (0.1, 0.1, 0.1), (0.001, 0.001, 0.001))
#: The largest coordinate of the grid.
LARGEST = 1 << 23


class Attack(NamedTuple):
    """A scene and a cell in it, in grid units, and how they are looked at."""

    meshes: list[Mesh]
    lo: np.ndarray  # (3,) float64
    hi: np.ndarray  # (3,) float64
    one_sided: bool
    cluster_size: int
    settings: EngineSettings


def nasty_scene(rng: np.random.Generator) -> Attack:
    """A scene of one of several kinds, anywhere on the grid, with a cell whose faces often touch or cut something."""
    size = int(rng.choice([40, 300, 3000, 100_000]))
    kind = rng.choice(["pile", "pile", "planks", "rooms", "voxels", "shutters"])
    if kind == "rooms":
        size = 3 * 4000
        meshes = rooms(rng, 3)
    elif kind == "planks":
        meshes = _planks(rng, size)
    elif kind == "voxels":
        meshes = _voxels(rng, size)
    elif kind == "shutters":
        meshes = _shutters(rng, size)
    else:
        meshes = _pile(rng, size)
    low, high = (-size, size) if kind != "rooms" else (200, size - 200)
    centre = rng.integers(low, high, 3, endpoint=True).astype(np.float64) * rng.choice([0.2, 0.7])
    half = np.maximum(np.array(SHAPES[rng.integers(len(SHAPES))])[rng.permutation(3)] * size, 0.5)
    lo, hi = centre - half, centre + half
    if rng.random() < 0.5:  # a face of the cell in the plane of some vertex
        points = meshes[rng.integers(len(meshes))][0]
        axis, place = rng.integers(3), float(points[rng.integers(len(points))][rng.integers(3)])
        width = hi[axis] - lo[axis]
        lo[axis], hi[axis] = (place, place + width) if rng.random() < 0.5 else (place - width, place)
    if rng.random() < 0.2:  # far from the grid's centre
        reach = max(int(np.abs(points).max()) for points, _ in meshes) + 1
        shift = rng.integers(-(LARGEST - reach), LARGEST - reach, 3).astype(np.int32)
        meshes = [((points + shift).astype(np.int32), triangles) for points, triangles in meshes]
        lo, hi = lo + shift, hi + shift
    settings = EngineSettings(
        resolution=int(rng.choice([16, 64, 64, 256])), proof_resolution=32, smallest_window=int(rng.choice([1, 16])),
        largest_flooded_set=int(rng.choice([4, 64, 2048])), layers=int(rng.choice([1, 2, 4])),
    )  # fmt: skip
    return Attack(meshes, lo, hi, bool(rng.random() < 0.4), int(rng.choice([1, 3, 32])), settings)


def misses(attack: Attack, rays: int, seed: int) -> list[Sight]:
    """What rays see of a scene that the engine does not report."""
    soup = soup_of(attack.meshes, one_sided=attack.one_sided, cluster_size=attack.cluster_size)
    found = Engine(soup, attack.settings).visible_from(attack.lo, attack.hi, soup.drawables)
    assert found is not None
    assert set(found.proven) <= set(found.visible)
    corners = soup.vertices[soup.triangles].astype(np.float32)
    owner = soup.triangle_drawable.astype(np.int64)
    oracle = Oracle(corners, owner, soup.one_sided[owner])
    rng = np.random.default_rng(seed)
    return examine(oracle, owner, corners, attack.lo, attack.hi, found.visible, rays, rng).missed


def _pile(rng: np.random.Generator, size: int) -> list[Mesh]:
    """Slivers, coplanar and coincident faces, cracks of a grid step, touching corners, huge and tiny ones."""
    meshes: list[Mesh] = []
    for _ in range(int(rng.integers(2, 15))):
        at = rng.integers(-size, size, 3)
        extent = rng.integers(1, max(int(size * rng.choice([0.01, 0.2, 2.0])), 2), 3) + 1
        kind = rng.integers(7)
        if kind == 0:
            meshes.append(box(tuple(at), tuple(at + extent)))
        elif kind == 1:
            flat = int(rng.integers(0, 3))
            end = at + extent * 4
            end[flat] = at[flat]
            meshes.append(sheet(tuple(at), tuple(end), int(rng.integers(1, 6))))
        elif kind == 2:  # a fan: many triangles around one edge
            around = rng.integers(-size, size, (6, 3)) + at
            points = np.concatenate([[at], around, [at + extent]]).astype(np.int32)
            meshes.append((points, np.array([[0, 7, i] for i in range(1, 7)])))
        elif kind == 3:
            points = np.array([at, at + extent * 5, at + extent * 5 + rng.integers(0, 2, 3)], np.int32)
            meshes.append((points, np.array([[0, 1, 2]])))
        elif kind == 4 and meshes:
            positions, triangles = meshes[-1]
            meshes.append((positions.copy(), triangles[:, ::-1].copy()))
        elif kind == 5 and meshes:
            positions, triangles = meshes[-1]
            meshes.append(((positions + rng.integers(-1, 2, 3)).astype(np.int32), triangles))
        else:
            points = (rng.integers(-size // 2, size // 2 + 1, (9, 3)) + at).astype(np.int32)
            meshes.append((points, rng.integers(0, 9, (int(rng.integers(1, 9)), 3))))
    return meshes


def _planks(rng: np.random.Generator, size: int) -> list[Mesh]:
    """Long floors, walls and beams that run away from the middle, with things behind them."""
    meshes: list[Mesh] = []
    for _ in range(int(rng.integers(3, 12))):
        extent = rng.integers(1, max(size // 10, 2), 3)
        long = rng.permutation(3)[: rng.integers(1, 3)]
        extent[long] = rng.integers(size // 2 + 1, 3 * size, len(long))
        at = rng.integers(-size, size, 3)
        meshes.append(box(tuple(at), tuple(at + extent)))
    for _ in range(int(rng.integers(3, 20))):
        at = rng.integers(-2 * size, 2 * size, 3)
        meshes.append(box(tuple(at), tuple(at + rng.integers(1, max(size // 20, 2), 3))))
    return meshes


def _voxels(rng: np.random.Generator, size: int) -> list[Mesh]:
    """Cubes on a lattice, so that faces, edges and corners touch; now and then one a step out of place."""
    step = max(size // 8, 2)
    meshes: list[Mesh] = []
    for place in rng.integers(-8, 8, (int(rng.integers(5, 40)), 3)):
        at = place * step + (rng.integers(-1, 2, 3) if rng.random() < 0.1 else 0)
        meshes.append(box(tuple(at), tuple(at + step)))
    return meshes


def _shutters(rng: np.random.Generator, size: int) -> list[Mesh]:
    """Sheets one behind the other, in strips with gaps of a step or none, T-junctions, and a thing behind each."""
    meshes: list[Mesh] = []
    axis = int(rng.integers(3))
    across, along = (k for k in range(3) if k != axis)
    for depth in np.sort(rng.integers(size // 20 + 1, size + 2, int(rng.integers(2, 6)))) * rng.choice([-1, 1]):
        start = -size
        while start < size:
            end = min(start + int(rng.integers(1, size // 2 + 2)), size)
            lo, hi = np.zeros(3, np.int64), np.zeros(3, np.int64)
            lo[axis] = hi[axis] = depth
            lo[across], hi[across] = start, end
            lo[along], hi[along] = -size, size - rng.integers(0, size // 2 + 1)
            meshes.append(sheet(tuple(lo), tuple(hi), int(rng.integers(1, 4))))
            start = end + int(rng.choice([0, 0, 1, size // 20]))
        thing = rng.integers(-size, size, 3)
        thing[axis] = depth + np.sign(depth) * rng.integers(1, size // 10 + 2)
        meshes.append(box(tuple(thing), tuple(thing + rng.integers(1, size // 10 + 2, 3))))
    return meshes
