"""Small scenes for visibility tests, as lists of (positions in grid units, triangles)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from jobs.checking.oracle import Oracle
from jobs.visibility.surfaces.soup import Soup, build_soup

Mesh = tuple[np.ndarray, np.ndarray]

_FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
     [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
)  # fmt: skip


def box(lo: tuple[int, int, int], hi: tuple[int, int, int]) -> Mesh:
    """A closed box, wound outward."""
    corners = np.array([[(lo, hi)[bit >> k & 1][k] for k in range(3)] for bit in range(8)], np.int32)
    return corners, _FACES


def sheet(lo: tuple[int, int, int], hi: tuple[int, int, int], cells: int) -> Mesh:
    """A flat rectangle at right angles to the axis where lo == hi, cut into cells x cells squares."""
    flat = next(k for k in range(3) if lo[k] == hi[k])
    a, b = (k for k in range(3) if k != flat)
    steps = np.linspace(0, 1, cells + 1)
    grid = np.zeros(((cells + 1) ** 2, 3))
    grid[:, flat] = lo[flat]
    grid[:, a] = np.repeat(lo[a] + (hi[a] - lo[a]) * steps, cells + 1)
    grid[:, b] = np.tile(lo[b] + (hi[b] - lo[b]) * steps, cells + 1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    one = np.stack([corner, corner + 1, corner + cells + 1], axis=1)
    two = np.stack([corner + 1, corner + cells + 2, corner + cells + 1], axis=1)
    return np.rint(grid).astype(np.int32), np.concatenate([one, two])


def soup_of(
    meshes: list[Mesh],
    one_sided: bool = False,
    cluster_size: int = 32,
    seal: float = 0.0,
    see_through: Collection[int] = (),
) -> Soup:
    """Each mesh as one drawable, numbered from 0; seal: see `build_soup`; see_through: numbers of those with two sides
    that can be seen through.
    """
    n = len(meshes)
    clear = np.isin(np.arange(n), list(see_through))
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    return build_soup(
        np.arange(n),
        one_sided & ~clear,
        clear,
        np.concatenate([points for points, _ in meshes]).astype(np.int32),
        np.concatenate([triangles + start for (_, triangles), start in zip(meshes, starts[:-1], strict=True)]),
        np.array([len(triangles) for _, triangles in meshes]),
        cluster_size,
        seal,
    )


def oracle_of(soup: Soup) -> Oracle:
    """An oracle over all triangles of a soup, whose owners are its `triangle_drawable`."""
    owner = soup.triangle_drawable.astype(np.int64)
    corners = soup.vertices[soup.triangles].astype(np.float32)
    return Oracle(corners, owner, soup.one_sided[owner], soup.see_through[owner])


def rooms(rng: np.random.Generator, per_side: int, size: int = 4000, wall: int = 100) -> list[Mesh]:
    """per_side x per_side rooms in one storey: slabs, walls with door gaps made of boxes, and a few things inside."""
    span = per_side * size
    meshes = [box((-wall, -wall, -wall), (span + wall, span + wall, 0))]
    meshes.append(box((-wall, -wall, size), (span + wall, span + wall, size + wall)))
    for i in range(per_side + 1):
        for j in range(per_side):
            door = int(rng.integers(size // 4, size // 2))
            outside = i in {0, per_side}
            for along in (0, 1):
                pieces = [(0, size)] if outside else [(0, door), (door + size // 5, size)]
                for start, end in pieces:
                    lo, hi = [0, 0, 0], [0, 0, size]
                    lo[along], hi[along] = j * size + start, j * size + end
                    lo[1 - along], hi[1 - along] = i * size - wall // 2, i * size + wall // 2
                    meshes.append(box((lo[0], lo[1], lo[2]), (hi[0], hi[1], hi[2])))
    for _ in range(6 * per_side * per_side):
        at = rng.integers(200, span - 600, 2)
        extent = rng.integers(50, 400, 3)
        meshes.append(
            box((int(at[0]), int(at[1]), 0), (int(at[0] + extent[0]), int(at[1] + extent[1]), int(extent[2])))
        )
    return meshes
