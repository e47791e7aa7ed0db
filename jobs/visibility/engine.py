"""One view cell: from its cut to what may be seen from it, and how much of that is proven.

The narrow interface to from-region visibility: cell and cut in, visible ids and certificate out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.visibility import back_faces, item_buffer, occludees, occluders
from jobs.visibility.flood import Mesh
from jobs.visibility.layers import clear_layers
from jobs.visibility.methods import METHODS
from jobs.visibility.shrunk_occluders import ShrunkOccluders
from jobs.visibility.soup import Soup

#: The corners of the cell, those of a tetrahedron first.
PROOF_CORNERS = (
    (-1.0, -1.0, -1.0), (1.0, 1.0, -1.0), (1.0, -1.0, 1.0), (-1.0, 1.0, 1.0),
    (1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, -1.0, -1.0),
)  # fmt: skip


#: What is hidden up to this depth at least, in cell coordinates, is hidden however deep it is.
FARTHEST = 8.0


@dataclass(frozen=True)
class EngineSettings:
    """How hard the engine tries; every setting is safe, they only trade time for tightness."""

    method: str = METHODS[0]  # one of jobs.visibility.methods
    resolution: int = 256  # pixels along the edge of a cube face
    layers: int = 4  # pairs of depths that a pixel keeps
    largest_flooded_set: int = 2048  # triangles in one flooded occluder set
    smallest_window: int = 16  # pixels that a core's image must span to be worth flooding from
    cluster_size: int = 32  # triangles in a cluster: the cores of the floods, the units of the finer tests
    proof_resolution: int = 128  # pixels along the edge of an item buffer's cube face; 0: prove nothing
    proof_points: int = 4  # corners of the cell from which item buffers are drawn, 8 at most

    #: Part of the task keys: change it whenever results may change.
    version: int = 3


@dataclass(frozen=True)
class CellVisibility:
    """What may be seen from a cell."""

    visible: np.ndarray  # (k,) int64 sorted ids: a superset of what can be seen
    proven: np.ndarray  # (p,) int64 sorted ids among them, seen from points of the cell


class Engine:
    """Answers cells of one task. Holds the buffers, so that no cell allocates them anew."""

    def __init__(self, soup: Soup, settings: EngineSettings) -> None:
        """Take the triangles that the cells of the task share."""
        self.soup = soup
        self.settings = settings
        self._q = np.empty((len(soup.vertices), 3), np.float64)
        self._side = np.empty(len(soup.triangles), np.int8)
        r = settings.resolution
        self._layers = np.empty((6, r, r, settings.layers, 2), np.float32)
        self._shrunk = ShrunkOccluders(soup, r) if settings.method == "shrunk-occluders" else None

    def reaching_into(self, lo: np.ndarray, hi: np.ndarray, cut: np.ndarray) -> np.ndarray:
        """Those drawables of a cut (sorted ids) of which a vertex lies in the cell: surely visible, found quickly.

        Args: as for `visible_from`.
        """
        soup = self.soup
        places = soup.places(cut)
        near = places[((soup.drawable_lo[places] <= hi) & (soup.drawable_hi[places] >= lo)).all(axis=1)]
        reaching = []
        for d in near:
            first, last = soup.drawable_clusters[d], soup.drawable_clusters[d + 1]
            corners = soup.vertices[soup.triangles[soup.cluster_start[first] : soup.cluster_start[last]]]
            if ((corners > lo) & (corners < hi)).all(axis=2).any():
                reaching.append(d)
        return soup.drawables[np.array(reaching, np.int64)]

    def visible_from(
        self, lo: np.ndarray, hi: np.ndarray, cut: np.ndarray, most_triangles: int | None = None
    ) -> CellVisibility | None:
        """What of a cut may be seen from anywhere in a cell.

        Args:
            lo, hi: (3,) float64 the cell in grid units, lo < hi.
            cut: (c,) sorted int64 ids, all in the soup.
            most_triangles: give up as soon as more triangles than this are reported: the cell will be split.

        Returns:
            None where it gave up.
        """
        soup = self.soup
        places = soup.places(cut)
        solid = places[soup.one_sided[places]]
        backs = back_faces.backs_only(
            soup.drawable_lo[solid], soup.drawable_hi[solid], lo, hi, soup.cone_axis[solid], soup.cone_angle[solid]
        )
        places = np.setdiff1d(places, solid[backs], assume_unique=True)
        active = np.zeros(len(soup.drawables), np.bool_)
        active[places] = True
        centre = 0.5 * (lo + hi)
        # grown by far more than rounding, so that the cell is inside what is worked with
        half = 0.5 * (hi - lo) * (1 + 1e-9) + 1e-6
        occluders.to_cell_coordinates(soup.vertices, centre, half, self._q)
        occluders.find_sides(soup.vertices, soup.triangles, soup.triangle_drawable, active, centre, half, self._side)
        proven: np.ndarray | None = None
        if most_triangles is not None and soup.triangle_counts[places].sum() > most_triangles:
            # seeing too much already is quicker to find out than how much too much
            proven = self._prove(places, most_triangles)
            if soup.triangle_counts[proven].sum() > most_triangles:
                return None
        side = self._side
        usable = (side != 0) & ~((side < 0) & soup.one_sided[soup.triangle_drawable])
        cluster_lo = (soup.cluster_lo - centre) / half
        cluster_hi = (soup.cluster_hi - centre) / half
        if self._shrunk is not None:
            seen = self._shrunk.find_visible(self._q, side, usable, places, cluster_lo, cluster_hi)
        else:
            seen = self._find_visible(places, active, usable, cluster_lo, cluster_hi, centre, half, most_triangles)
        visible = places[seen]
        if most_triangles is not None and soup.triangle_counts[visible].sum() > most_triangles:
            return None
        if proven is None:
            proven = self._prove(visible)
        return CellVisibility(soup.drawables[visible], soup.drawables[np.intersect1d(proven, visible)])

    def _find_visible(
        self,
        places: np.ndarray,
        active: np.ndarray,
        usable: np.ndarray,
        cluster_lo: np.ndarray,
        cluster_hi: np.ndarray,
        centre: np.ndarray,
        half: np.ndarray,
        most_triangles: int | None,
    ) -> np.ndarray:
        """Which drawables flooded occluder sets do not hide.

        Args:
            places: (d,) drawables, as positions in the soup; active: (all,) bool the same.
            usable: (m,) bool triangles that may occlude.
            cluster_lo, cluster_hi: (k, 3) float64 boxes in cell coordinates; centre, half: (3,) the cell in grid units.

        Returns:
            (d,) bool.
        """
        soup, side = self.soup, self._side
        drawable_lo = (soup.drawable_lo - centre) / half
        drawable_hi = (soup.drawable_hi - centre) / half

        in_cut = np.flatnonzero(active[soup.cluster_drawable])
        nearest = np.maximum(np.maximum(cluster_lo[in_cut], -cluster_hi[in_cut]), 0).max(axis=1)
        order = in_cut[np.argsort(nearest, kind="stable")]
        corners = np.abs(np.concatenate([cluster_lo[in_cut], cluster_hi[in_cut]]))
        farthest = float(corners.max(initial=FARTHEST)) * (1 + 1e-6)
        clear_layers(self._layers)
        mesh = Mesh(
            self._q, side, usable, soup.triangles, soup.triangle_edges, soup.edge_start, soup.edge_uses
        )  # fmt: skip
        occluders.cover(
            mesh, soup.cluster_start, order, cluster_lo, cluster_hi, soup.cluster_breadth / half.min(), farthest,
            self.settings.largest_flooded_set, self.settings.smallest_window, self._layers,
        )  # fmt: skip
        seen: np.ndarray = occludees.find_visible(
            self._q, side, soup.triangles, places, soup.one_sided, soup.drawable_clusters, soup.cluster_start,
            cluster_lo, cluster_hi, drawable_lo, drawable_hi, self._layers,
            soup.triangle_counts, -1 if most_triangles is None else most_triangles,
        )  # fmt: skip
        return seen

    def _prove(self, places: np.ndarray, most_triangles: int | None = None) -> np.ndarray:
        """Which of some drawables item buffers see from the cell's corners; enough of them to be more than a number.

        Args:
            places: (k,) drawables, as positions in the soup: all that may be seen.
            most_triangles: stop as soon as drawables of more triangles than this are seen.
        """
        soup = self.soup
        if not self.settings.proof_resolution:
            return places[:0]
        seen = np.zeros(len(soup.drawables), np.bool_)
        drawn = np.zeros(len(soup.drawables), np.bool_)
        drawn[places] = True
        triangles = np.flatnonzero(drawn[soup.triangle_drawable])
        for corner in PROOF_CORNERS[: self.settings.proof_points]:
            eye = np.array(corner) * (1 - 1e-9)
            item_buffer.see(
                self._q, soup.triangles, triangles, soup.triangle_drawable, soup.one_sided, eye,
                self.settings.proof_resolution, seen,
            )  # fmt: skip
            if most_triangles is not None and soup.triangle_counts[seen].sum() > most_triangles:
                break
        proven: np.ndarray = places[seen[places]]
        return proven
