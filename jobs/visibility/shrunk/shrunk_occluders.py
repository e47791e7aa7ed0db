"""The vLOD paper's own way to find what is hidden: shrunk occluders around projection points. A baseline to compare.

Based on: J. Chhugani, B. Purnomo, S. Krishnan, J. Cohen, S. Venkatasubramanian, D. Johnson, S. Kumar: vLOD:
High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005, section 5.2.

Occluders are convex polygons of adjacent triangles (`planar_polygons`), clustered by their direction. Each cluster has
its projection point (`projection_point`, with the proof); its occluders are drawn from there, shrunk, where they cover
pixels in full, and what they hide is taken from the list of what may be seen (`shrunk_depths`). The paper asks of whole
objects whether one cluster hides them; here triangles are asked, which hides more: an object may be hidden by several
clusters. As clusters of fewer occluders shrink less and larger ones hide more together, directions are cut coarsely,
then finer. Bent groups of triangles, of which the paper speaks without a rule for shrinking them, are not used, and
neither are polygons that can be seen through.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.images.layers import clear_layers
from jobs.visibility.shrunk.planar_polygons import convex_polygons
from jobs.visibility.shrunk.projection_point import projection_point
from jobs.visibility.shrunk.shrunk_depths import draw_shrunk, find_occluders, hide, move_to
from jobs.visibility.surfaces.seen_mesh import TURNED, Mesh, look_at_all
from jobs.visibility.surfaces.soup import Soup

#: Each face of the cube of directions is cut into this many by as many clusters, one after the other.
DIRECTIONS = (1, 2, 4)


class ShrunkOccluders:
    """The occluders of a soup, and the buffers to draw them."""

    def __init__(self, soup: Soup, resolution: int) -> None:
        """Join the soup's triangles into polygons. resolution: pixels along the edge of a cube face."""
        self._soup = soup
        self._corners, self._counts, self._first = convex_polygons(
            soup.vertices, soup.triangles, soup.triangle_drawable
        )
        self._moved = np.empty((len(soup.vertices), 3), np.float64)
        self._layers = np.empty((6, resolution, resolution, 1, 2), np.float32)

    def find_visible(self, mesh: Mesh, places: np.ndarray) -> np.ndarray:
        """Which drawables (d,) of a cell's cut, positions in the soup, may be seen from it: (d,) bool."""
        look_at_all(mesh)
        q, side = mesh.q, mesh.side
        soup = self._soup
        occluders, faces, heights, sides = find_occluders(
            q, self._corners, self._counts, np.flatnonzero(np.abs(side[self._first]) == 1)
        )
        # backs of one-sided drawables are not seen
        hidden = side == TURNED
        asked = np.zeros(len(soup.drawables), np.bool_)
        asked[places] = True
        clusters = np.flatnonzero(asked[soup.cluster_drawable])
        cluster_lo, cluster_hi = ((box - mesh.centre) / mesh.half for box in (soup.cluster_lo, soup.cluster_hi))
        middle = np.zeros((len(occluders), 3))
        for corner in range(self._corners.shape[1]):
            has = self._counts[occluders] > corner
            middle[has] += q[self._corners[occluders[has], corner]]
        clear_layers(self._layers)
        drawn: set[bytes] = set()
        for parts in DIRECTIONS:
            direction = _directions(middle, parts)
            for chosen in np.split(np.argsort(direction, kind="stable"), np.cumsum(np.bincount(direction))[:-1]):
                if not len(chosen) or chosen.tobytes() in drawn:
                    continue
                drawn.add(chosen.tobytes())
                v = projection_point(faces, heights, sides, chosen)
                faces_drawn = draw_shrunk(faces, sides, chosen, v, self._layers)
                if faces_drawn.any():
                    move_to(q, v, self._moved)
                    left = hide(
                        q, self._moved, v, soup.triangles, clusters, soup.cluster_start, cluster_lo, cluster_hi,
                        self._layers, hidden,
                    )  # fmt: skip
                    clusters = clusters[left]
                for face in np.flatnonzero(faces_drawn):
                    clear_layers(self._layers[face : face + 1])
        seen = np.zeros(len(soup.drawables), np.bool_)
        seen[soup.triangle_drawable[~hidden]] = True
        visible: np.ndarray = seen[places]
        return visible


def _directions(points: np.ndarray, parts: int) -> np.ndarray:
    """(n,) int64: into which part of which face of a cube, cut into parts by parts, each point (n, 3) projects."""
    axis = np.abs(points).argmax(axis=1)
    rows = np.arange(len(points))
    depth = points[rows, axis]
    u = points[rows, (axis + 1) % 3] / np.abs(depth)
    v = points[rows, (axis + 2) % 3] / np.abs(depth)
    i, j = (np.minimum((0.5 * (w + 1) * parts).astype(np.int64), parts - 1) for w in (u, v))
    direction: np.ndarray = ((2 * axis + (depth < 0)) * parts + j) * parts + i
    return direction
