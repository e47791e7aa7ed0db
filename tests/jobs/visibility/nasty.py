"""Scenes that try to make the engine miss something, from a random generator alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.checking.oracle import Oracle, Sight, examine, surface_points
from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from tests.jobs.visibility.scenes import Mesh, box, oracle_of, rooms, sheet, soup_of

#: Half extents of cells, as parts of the scene's size.
SHAPES = ((0.02, 0.02, 0.02), (0.2, 0.02, 0.002), (0.003, 0.003, 0.3), (0.1, 0.1, 0.1), (0.001, 0.001, 0.001))
#: The largest coordinate of the grid.
LARGEST = 1 << 23
#: No core's window is as large: shafts decide everything.
NO_IMAGES = 1 << 30
#: Rays at each thing that peeps past an edge.
AIMED = 8


class Attack(NamedTuple):
    """A scene and a cell in it, in grid units, and how they are looked at."""

    meshes: list[Mesh]
    lo: np.ndarray  # (3,) float64
    hi: np.ndarray  # (3,) float64
    one_sided: bool
    see_through: list[int]  # meshes
    cluster_size: int
    settings: EngineSettings
    first_peeping: int  # the meshes from here on may be seen past an edge from a point of the cell
    eyes: np.ndarray  # (n, 3) float32 these points
    aims: np.ndarray  # (n, 3, 3) float32 the triangles that may be seen from there


def nasty_scene(rng: np.random.Generator) -> Attack:
    """A scene of one of several kinds, anywhere on the grid, with a cell whose faces often touch or cut something."""
    kind = rng.choice(["pile", "pile", "planks", "rooms", "voxels", "shutters", "screens", "screens", "overlaps"])
    size = 12_000 if kind == "rooms" else int(rng.choice([40, 300, 3000, 100_000]))
    low, high = (-size, size) if kind != "rooms" else (200, size - 200)
    centre = rng.integers(low, high, 3, endpoint=True).astype(np.float64) * rng.choice([0.2, 0.7])
    half = np.maximum(np.array(SHAPES[rng.integers(len(SHAPES))])[rng.permutation(3)] * size, 0.5)
    if kind in {"screens", "overlaps"}:
        half = np.maximum(half, 50)
    if kind == "screens":
        meshes = _screens(rng, centre, half)
    elif kind == "overlaps":
        meshes = _overlaps(rng, centre, half)
    elif kind == "rooms":
        meshes = rooms(rng, 3)
    else:
        meshes = {"pile": _pile, "planks": _planks, "voxels": _voxels, "shutters": _shutters}[str(kind)](rng, size)
    lo, hi = centre - half, centre + half
    if rng.random() < (0.1 if kind == "screens" else 0.5):  # a face of the cell in the plane of some vertex
        points = meshes[rng.integers(len(meshes))][0]
        axis, place = rng.integers(3), float(points[rng.integers(len(points))][rng.integers(3)])
        width = hi[axis] - lo[axis]
        lo[axis], hi[axis] = (place, place + width) if rng.random() < 0.5 else (place - width, place)
    if rng.random() < 0.2:  # far from the grid's centre
        reach = max(int(np.abs(points).max()) for points, _ in meshes) + 1
        shift = rng.integers(-(LARGEST - reach), LARGEST - reach, 3).astype(np.int32)
        meshes = [((points + shift).astype(np.int32), triangles) for points, triangles in meshes]
        lo, hi = lo + shift, hi + shift
    peeping, eyes, aims = _peeping(
        rng, meshes, lo, hi, {"screens": 100, "overlaps": 20}.get(kind, int(rng.choice([0, 0, 10])))
    )
    settings = EngineSettings(
        resolution=int(rng.choice([16, 128, 256, 256, 256, 512] if kind == "screens" else [16, 64, 64, 256])),
        proof_resolution=32, smallest_window=int(rng.choice([1, 16, NO_IMAGES])), layers=int(rng.choice([1, 2, 4])),
        largest_flooded_set=int(rng.choice([4, 64, 2048])),
        shafts=int(rng.choice([0, 20_000, 20_000])), least_worth=float(rng.choice([1.0, 0.1, 0.001])),
    )  # fmt: skip
    one_sided, cluster_size = bool(rng.random() < 0.4), int(rng.choice([1, 3, 32]))
    panes = rng.spawn(1)[0]  # takes nothing from the stream that the rest of the scene, and of a test, is made of
    share = panes.choice([0.0, 0.0, 0.1, 0.3, 0.7, 1.0])  # of what can be seen through
    return Attack(
        meshes + peeping,
        lo,
        hi,
        one_sided,
        np.flatnonzero(panes.random(len(meshes) + len(peeping)) < share).tolist(),
        cluster_size,
        settings,
        len(meshes),
        eyes,
        aims,
    )


def misses(attack: Attack, rays: int, seed: int) -> list[Sight]:
    """What rays see of a scene that the engine does not report."""
    soup = soup_of(attack.meshes, attack.one_sided, attack.cluster_size, see_through=attack.see_through)
    found = Engine(soup, attack.settings).visible_from(attack.lo, attack.hi, soup.drawables)
    assert found is not None
    assert set(found.proven) <= set(found.visible)
    oracle = oracle_of(soup)
    rng = np.random.default_rng(seed)
    missed = examine(oracle, attack.lo, attack.hi, found.visible, rays, rng).missed
    return missed + _aimed(oracle, soup.triangle_drawable, attack, found.visible, rng)


def _aimed(
    oracle: Oracle,
    owner: np.ndarray,
    attack: Attack,
    visible: np.ndarray,
    rng: np.random.Generator,
) -> list[Sight]:
    """What is not reported of the things that may peep past an edge, looked for from where they should be seen."""
    missed: list[Sight] = []
    peeping = range(attack.first_peeping, len(attack.meshes))
    for eye, aim, drawable in zip(attack.eyes, attack.aims, peeping, strict=True):
        if drawable in visible:
            continue
        weights = rng.dirichlet((1.0, 1.0, 1.0), AIMED)
        targets = weights @ aim.astype(np.float64)
        origins = np.repeat(eye[None], AIMED, axis=0)
        directions = (targets - origins).astype(np.float32)
        hits, along = oracle.cast(origins, directions)
        through, panes = oracle.passed(origins, directions, along)
        who = np.concatenate([np.flatnonzero(hits >= 0), through])
        for ray, hit in zip(who.tolist(), [*hits[hits >= 0].tolist(), *panes.tolist()], strict=True):
            if owner[hit] not in visible:
                origin, direction = origins[ray], directions[ray]
                distance = oracle.confirm(origin, direction, hit)
                if not np.isnan(distance):
                    missed.append(Sight(int(owner[hit]), tuple(origin.tolist()), tuple(direction.tolist()), distance))
                    break
    return missed


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


def _screens(rng: np.random.Generator, centre: np.ndarray, half: np.ndarray) -> list[Mesh]:
    """Large sheets of many triangles near the cell, flat or folded, with holes, each cut into several drawables.

    Their silhouettes are inflated over many of their own triangles, so that sets must be flooded far to meet them.
    """
    meshes: list[Mesh] = []
    while not meshes or rng.random() < 0.4:
        cells = int(rng.choice([2, 10, 24]))
        depth = 1 + float(np.exp(rng.uniform(np.log(0.01), np.log(11))))
        axis = int(rng.integers(3))
        steps = np.linspace(-1, 1, cells + 1)
        place = np.zeros((cells + 1, cells + 1, 3))
        place[:, :, (axis + 1) % 3] = (rng.uniform(-0.6, 0.6) + np.exp(rng.uniform(-0.7, 1.2)) * steps[:, None]) * depth
        place[:, :, (axis + 2) % 3] = (rng.uniform(-0.6, 0.6) + np.exp(rng.uniform(-0.7, 1.2)) * steps[None, :]) * depth
        fold = rng.choice([0.0, 0.0, 0.05, 0.3]) * depth * (np.arange(cells + 1) % 2)
        place[:, :, axis] = (depth + fold[:, None]) * rng.choice([-1, 1])
        points = np.rint(centre + half * place.reshape(-1, 3)).astype(np.int32)
        kept = np.flatnonzero(rng.random(cells * cells) >= rng.choice([0.0, 0.0, 0.02, 0.2]))
        corner = kept // cells * (cells + 1) + kept % cells
        one = np.stack([corner, corner + 1, corner + cells + 1], axis=1)
        two = np.stack([corner + 1, corner + cells + 2, corner + cells + 1], axis=1)
        pieces = kept * int(rng.integers(1, 4)) // (cells * cells)
        for piece in np.unique(pieces):
            triangles = np.concatenate([one[pieces == piece], two[pieces == piece]])
            meshes.append((points, triangles[:, ::-1] if rng.random() < 0.5 else triangles))
    return meshes


def _overlaps(rng: np.random.Generator, centre: np.ndarray, half: np.ndarray) -> list[Mesh]:
    """A few rectangles and folded strips one behind the other, whose edges cross the same lines of sight.

    Each hides part of what can be seen past the others' edges: what is hidden is hidden by several together.
    """
    meshes: list[Mesh] = []
    axis, sign = int(rng.integers(3)), int(rng.choice([-1, 1]))
    middle = rng.uniform(-0.3, 0.3, 2)  # where the lines of sight lead, as slopes
    depth = 1.0
    for _ in range(int(rng.integers(2, 6))):
        depth += float(np.exp(rng.uniform(np.log(0.02), np.log(3))))
        width = np.exp(rng.uniform(np.log(0.3), np.log(8), 2)) * rng.choice([1.0, 1.0, 10.0], 2)
        # one of its edges passes near the middle: by less than the cell is wide
        side = rng.choice([-1, 1], 2)
        near = middle * depth + rng.uniform(-1, 1, 2) * rng.choice([0.1, 0.5, 1.0])
        far = near + side * width
        near = np.where(rng.random(2) < 0.4, near - side * width, near)  # or that extent spans the middle
        fold = float(rng.choice([0.0, 0.0, 0.3, -0.3]))
        corners = np.zeros((6, 3))
        for row, part in enumerate((0.0, float(rng.uniform(0.1, 0.9)), 1.0)):
            for column, place in enumerate((near[1], far[1])):
                at = corners[2 * row + column]
                at[(axis + 1) % 3], at[(axis + 2) % 3] = near[0] + part * (far[0] - near[0]), place
                at[axis] = sign * (depth + (fold if row == 1 else 0.0))
        points = np.rint(centre + half * corners).astype(np.int32)
        triangles = np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
        meshes.append((points, triangles[:, ::-1] if rng.random() < 0.5 else triangles))
    return meshes


def _peeping(
    rng: np.random.Generator, meshes: list[Mesh], lo: np.ndarray, hi: np.ndarray, count: int
) -> tuple[list[Mesh], np.ndarray, np.ndarray]:
    """Up to `count` small triangles, each on a line of sight from a point of the cell right past an edge of something.

    Mostly from the corner of the cell that sees farthest past it, and past an edge of one triangle alone where there is
    one: things that can hardly be seen from anywhere else. Often others are part of the same drawable, somewhere around
    it. Returns the drawables, the points (n, 3) float32 and the triangles' corners (n, 3, 3) float32.
    """
    things: list[Mesh] = []
    eyes: list[np.ndarray] = []
    aims: list[np.ndarray] = []
    points_of_cell = surface_points(lo, hi, 32, rng)
    reach = float(np.linalg.norm(hi - lo))
    beyond = rng.choice([-1.0, 0.0, 1.5])  # things far behind all the rest inflate edges by the whole cell
    for _ in range(count):
        points, triangles = meshes[rng.integers(len(meshes))]
        ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, which, uses = np.unique(ends, axis=0, return_index=True, return_counts=True)
        single = which[uses == 1] if (uses == 1).any() and rng.random() < 0.8 else which
        triangle, side = divmod(int(single[rng.integers(len(single))]), 3)
        a, b, c = points[np.roll(triangles[triangle], -side)].astype(np.float64)
        along = b - a
        outward = (a - c) - along * ((a - c) @ along) / max(along @ along, 1e-9)
        aside = max(reach * 10 ** rng.uniform(-5, -1), 0.5) / max(np.linalg.norm(outward), 1e-9)
        past = a + rng.random() * along + aside * outward
        eye = points_of_cell[rng.integers(32)]
        if rng.random() < 0.7:  # the corner that sees most of what lies behind the edge's triangle
            sight = past - points_of_cell[:8]
            eye = points_of_cell[((sight @ outward) / np.linalg.norm(sight, axis=1)).argmin()]
        farther = rng.uniform(-3, beyond) if rng.random() < 0.5 else beyond - rng.exponential(0.3)
        at = np.rint(eye + (past - eye) * (1 + 10**farther)).astype(np.int64)
        extent = np.maximum(np.linalg.norm(at - eye) * 10 ** rng.uniform(-4, -1.5), 3)
        corners = at + np.rint(rng.uniform(-0.5, 0.5, (3, 3)) * extent).astype(np.int64)
        front = np.linalg.det(corners - eye.astype(np.float64))
        if (np.abs(corners) < LARGEST).all() and front != 0:
            others = int(rng.choice([0, 0, 1, 3, 20]))
            scatter = np.linalg.norm(at - eye) * 10 ** rng.uniform(-3, 0)
            around = at + rng.normal(size=(others, 1, 3)) * scatter + rng.uniform(-0.5, 0.5, (others, 3, 3)) * extent
            around = np.clip(np.rint(around), 1 - LARGEST, LARGEST - 1).astype(np.int32).reshape(-1, 3)
            triangles = np.arange(3 * others + 3).reshape(-1, 3)
            if front > 0:
                triangles[0] = [0, 2, 1]
            things.append((np.concatenate([corners.astype(np.int32), around]), triangles))
            eyes.append(eye)
            aims.append(corners)
    return things, np.array(eyes, np.float32).reshape(-1, 3), np.array(aims, np.float32).reshape(-1, 3, 3)
