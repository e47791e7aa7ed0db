"""One view cell: from its cut to what may be seen from it, and how much of that is proven.

The narrow interface to from-region visibility: cell and cut in, visible ids and certificate out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.visibility.flooding import occludees, occluders
from jobs.visibility.flooding.seals import ROWS, UNKNOWN, Seals
from jobs.visibility.images.layers import clear_layers
from jobs.visibility.proof import aimed_rays, item_buffer
from jobs.visibility.settings import EngineSettings
from jobs.visibility.shafts import closing_sets, undecided
from jobs.visibility.shrunk.shrunk_occluders import ShrunkOccluders
from jobs.visibility.surfaces import ray_tree, seen_mesh
from jobs.visibility.surfaces.clusters import make_clusters
from jobs.visibility.surfaces.inside import reaching_into
from jobs.visibility.surfaces.soup import Soup

#: The corners of the cell, those of a tetrahedron first.
PROOF_CORNERS = (
    (-1.0, -1.0, -1.0), (1.0, 1.0, -1.0), (1.0, -1.0, 1.0), (-1.0, 1.0, 1.0),
    (1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, -1.0, -1.0),
)  # fmt: skip


#: Item buffers are drawn from a little inside these corners, as aimed rays start.
EYE = 1.0 - aimed_rays.INSET

#: How the rays that a cell may aim are shared out: what few rays prove leaves more for the rest.
AIM_SHARES = (0.1, 0.2, 0.7)

#: Where images report this many times the triangles that a cell may have, shafts are not asked.
HOPELESS = 2

#: What is hidden up to this depth at least, in cell coordinates, is hidden however deep it is.
FARTHEST = 8.0


#: No gap counts as closed.
NO_SEALS = Seals(
    np.zeros(1, np.int64), np.zeros(0, np.int32), np.zeros((0, 2), np.float32), np.zeros(0, np.int8), np.zeros((0, 2)),
    np.ones(3), np.zeros(1),
)  # fmt: skip


@dataclass(frozen=True)
class CellVisibility:
    """What may be seen from a cell."""

    visible: np.ndarray  # (k,) int64 sorted ids: a superset of what can be seen
    proven: np.ndarray  # (p,) int64 sorted ids among them, seen from points of the cell


@dataclass(frozen=True)
class _Glimpses:
    """What item buffers from some points showed of all drawables: see `item_buffer.see`."""

    triangle: np.ndarray  # (points, drawables) int32
    pixel: np.ndarray  # (points, drawables) int32

    @property
    def seen(self) -> np.ndarray:
        """(drawables,) bool."""
        return np.asarray((self.triangle >= 0).any(axis=0), np.bool_)


class Engine:
    """Answers cells of one task. Holds the buffers, so that no cell allocates them anew."""

    def __init__(self, soup: Soup, settings: EngineSettings, images: np.ndarray | None = None) -> None:
        """Take the triangles that the cells of the task share; `images`: another engine's, see `on`."""
        self.soup = soup
        self.settings = settings
        self._mesh = seen_mesh.make_mesh(
            soup.vertices, soup.triangles, soup.triangle_edges, soup.edge_start, soup.edge_uses,
            soup.triangle_drawable, soup.one_sided, soup.see_through, ROWS if soup.gaps else 0,
        )  # fmt: skip
        self._clusters = make_clusters(
            soup.cluster_start, soup.cluster_drawable, soup.cluster_lo, soup.cluster_hi, soup.cluster_breadth
        )
        r = settings.resolution
        self._occluders = occluders.make_work(
            len(soup.vertices), soup.cluster_start, settings.largest_flooded_set, r, soup.gaps is not None
        )
        self._layers = np.empty((6, r, r, settings.layers, 2), np.float32) if images is None else images
        self._shrunk = ShrunkOccluders(soup, r) if settings.method == "shrunk-occluders" else None
        self._room = undecided.make_room(len(soup.triangles))
        self._first = soup.cluster_start[soup.drawable_clusters]
        self._scene, self._tree = ray_tree.build_scene(
            soup.vertices, soup.triangles, soup.triangle_drawable, soup.one_sided, soup.cluster_start
        )

    def on(self, soup: Soup) -> Engine:
        """An engine for other triangles that shares this one's images: use one of the two at a time."""
        return Engine(soup, self.settings, self._layers)

    def reaching_into(self, lo: np.ndarray, hi: np.ndarray, cut: np.ndarray) -> np.ndarray:
        """Those drawables of a cut (sorted ids) of which a vertex lies in the cell: surely visible, found quickly.

        Args: as for `visible_from`.
        """
        soup = self.soup
        places = soup.places(cut)
        near = places[((soup.drawable_lo[places] <= hi) & (soup.drawable_hi[places] >= lo)).all(axis=1)]
        reaching: np.ndarray = near[reaching_into(soup.vertices, soup.triangles, self._first, near, lo, hi)]
        return soup.drawables[reaching]

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
        if self.settings.sampled:
            return self._sample(lo, hi, places, most_triangles)
        centre = 0.5 * (lo + hi)
        # grown by far more than rounding, so that the cell is inside what is worked with
        half = 0.5 * (hi - lo) * (1 + 1e-9) + 1e-6
        seen_mesh.begin(self._mesh, places, centre, half)
        glimpses: _Glimpses | None = None
        if most_triangles is not None and soup.triangle_counts[places].sum() > most_triangles:
            # seeing too much already is quicker to find out than how much too much
            glimpses = self._glimpse(places, most_triangles)
            if soup.triangle_counts[glimpses.seen].sum() > most_triangles:
                return None
        decides = self.settings.shafts > 0 and self._shrunk is None
        most_reported = most_triangles if most_triangles is None or not decides else HOPELESS * most_triangles
        if self._shrunk is not None:
            seen = self._shrunk.find_visible(self._mesh, places)
        else:
            seen = self._find_visible(places, most_reported)
        visible = places[seen]
        if most_reported is not None and soup.triangle_counts[visible].sum() > most_reported:
            return None
        # what is proven to be hidden stands before nothing that can be seen; what is only taken to be may
        standing = self._standing(places if soup.gaps else visible)
        proven = self._prove(lo, hi, visible, standing, glimpses or self._glimpse(visible))
        if decides:
            visible, proven = self._decide(lo, hi, visible, standing, proven, most_triangles)
            if most_triangles is not None and soup.triangle_counts[visible].sum() > most_triangles:
                return None
        return CellVisibility(soup.drawables[visible], soup.drawables[proven])

    def _standing(self, places: np.ndarray) -> ray_tree.Scene:
        """What stops rays: those of some drawables (s,), positions in the soup, that cannot be seen through."""
        return ray_tree.prune(self._scene, self._tree, places[~self.soup.see_through[places]])

    def _panes(self, places: np.ndarray) -> ray_tree.Scene:
        """What rays go on through: those of some drawables (s,), positions in the soup, that can be seen through."""
        return ray_tree.prune(self._scene, self._tree, places[self.soup.see_through[places]])

    def _decide(
        self,
        lo: np.ndarray,
        hi: np.ndarray,
        visible: np.ndarray,
        standing: ray_tree.Scene,
        proven: np.ndarray,
        most_triangles: int | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """What is visible (k,) and what of it is proven (p,), once shafts have decided what they can.

        standing: what may stand before what is seen; most_triangles: go no further once it is sure to be more.
        """
        soup = self.soup
        surely = int(soup.triangle_counts[proven].sum())
        allowed = np.iinfo(np.int64).max if most_triangles is None else most_triangles - surely
        hidden, seen = (np.zeros(len(soup.drawables), np.bool_) for _ in range(2))
        seen[proven] = True
        closing_sets.forget_marks(self._room.work)
        undecided.decide(
            standing, self._mesh, self._clusters, self._layers, self._room,
            undecided.Asked(visible[~seen[visible]], soup.drawable_clusters, soup.triangle_counts), lo, hi,
            undecided.Effort(self.settings.shafts, self.settings.least_worth, allowed), hidden, seen,
        )  # fmt: skip
        return visible[~hidden[visible]], visible[seen[visible]]

    def _find_visible(self, places: np.ndarray, most_triangles: int | None) -> np.ndarray:
        """Which drawables (d,), positions in the soup, flooded occluder sets do not hide: (d,) bool."""
        soup = self.soup
        clear_layers(self._layers)
        farthest = max(occluders.farthest_of(self._mesh, soup.drawable_lo, soup.drawable_hi, places), FARTHEST)
        farthest = float(np.float32(farthest * (1 + 1e-6)))
        occluders.forget_marks(self._occluders)
        # first what is sure, then, if gaps count as closed, what is left
        for seals in (NO_SEALS, *([self._seals()] if soup.gaps else [])):
            occluders.cover(
                self._mesh, self._clusters, self._occluders, farthest, self.settings.smallest_window,
                self._layers, seals,
            )  # fmt: skip
        seen: np.ndarray = occludees.find_visible(
            self._mesh, self._clusters, self._layers, soup.triangle_counts,
            -1 if most_triangles is None else most_triangles,
        )  # fmt: skip
        return seen[places]

    def _seals(self) -> Seals:
        """The soup's gaps, of which nothing is known yet for the cell."""
        gaps = self.soup.gaps
        assert gaps is not None
        count = len(gaps.near)
        state, closed = np.full(count, UNKNOWN, np.int8), np.empty((count, 2), np.float64)
        return Seals(gaps.start, gaps.near, gaps.part, state, closed, self._mesh.half, np.array([gaps.distance]))

    def _glimpse(self, places: np.ndarray, most_triangles: int | None = None) -> _Glimpses:
        """What item buffers show from the cell's corners.

        Args:
            places: (k,) drawables, as positions in the soup, in front of which nothing else can be. Those that can be
                seen through are not drawn: they would take the pixels of what is behind them.
            most_triangles: stop as soon as drawables of more triangles than this are seen.
        """
        soup = self.soup
        count = self.settings.proof_points if self.settings.proof_resolution else 0
        triangle = np.full((count, len(soup.drawables)), -1, np.int32)
        pixel = np.zeros((count, len(soup.drawables)), np.int32)
        drawn = np.zeros(len(soup.drawables), np.bool_)
        drawn[places] = ~soup.see_through[places]
        for number, corner in enumerate(PROOF_CORNERS[:count]):
            item_buffer.see(
                self._mesh, self._clusters, drawn, np.array(corner) * EYE, self.settings.proof_resolution,
                triangle[number], pixel[number],
            )  # fmt: skip
            seen = _Glimpses(triangle, pixel).seen
            if most_triangles is not None and soup.triangle_counts[seen].sum() > most_triangles:
                break
        return _Glimpses(triangle, pixel)

    def _prove(
        self, lo: np.ndarray, hi: np.ndarray, visible: np.ndarray, standing: ray_tree.Scene, glimpses: _Glimpses
    ) -> np.ndarray:
        """Which of the drawables (k,) that may be seen surely are, as positions in the soup; `standing` may hide."""
        soup = self.soup
        proven = np.zeros(len(soup.drawables), np.bool_)
        if not self.settings.proof_resolution:
            return visible[:0]
        half = 0.5 * (hi - lo)
        eyes = 0.5 * (lo + hi) + half * EYE * np.array(PROOF_CORNERS)[: len(glimpses.triangle)]
        aimed_rays.confirm(
            standing, visible, eyes, half, glimpses.triangle, glimpses.pixel,
            self.settings.proof_resolution, proven,
        )  # fmt: skip
        self._aim(standing, visible, lo, hi, self.settings.aimed_rays, proven)
        surely: np.ndarray = visible[proven[visible]]
        return surely

    def _aim(
        self,
        standing: ray_tree.Scene,
        chosen: np.ndarray,
        lo: np.ndarray,
        hi: np.ndarray,
        rays: int,
        proven: np.ndarray,
    ) -> None:
        """So many rays at those of the drawables (k,) that are not proven visible, first a few at each, then more."""
        end, most = 0, self.settings.most_aimed_rays
        for share in AIM_SHARES:
            left = chosen[~proven[chosen]]
            begin, end = end, min(end + int(share * rays) // max(len(left), 1), most)
            aimed_rays.aim(standing, left, self._first, lo, hi, begin, end, proven)

    def _sample(
        self, lo: np.ndarray, hi: np.ndarray, places: np.ndarray, most_triangles: int | None
    ) -> CellVisibility | None:
        """What rays meet of some drawables (k,), positions in the soup, or None as in `visible_from`."""
        soup = self.soup
        seen, proven = (np.zeros(len(soup.drawables), np.bool_) for _ in range(2))
        standing = self._standing(places)
        aimed_rays.scatter(standing, self._panes(places), lo, hi, self.settings.sampling_rays, seen, proven)
        if most_triangles is not None and soup.triangle_counts[seen].sum() > most_triangles:
            return None
        self._aim(standing, places, lo, hi, self.settings.sampling_aimed_rays, proven)
        seen |= proven
        if most_triangles is not None and soup.triangle_counts[seen].sum() > most_triangles:
            return None
        return CellVisibility(soup.drawables[seen], soup.drawables[proven])

    def count_misses(
        self, lo: np.ndarray, hi: np.ndarray, cut: np.ndarray, visible: np.ndarray, rng: np.random.Generator
    ) -> int:
        """How many of `settings.hold_out_rays` meet what is not reported: those pixels would be wrong.

        Rays go on through what can be seen through, up to what they meet first besides.

        The rays start anywhere on the cell's surface in any direction, evenly spread, and took no part in sampling.

        Args:
            lo, hi, cut: as for `visible_from`; visible: what it reported.
        """
        reported, places = self.soup.places(visible), self.soup.places(cut)
        drawn = np.zeros(len(self.soup.drawables), np.bool_)
        drawn[reported] = True
        count = self.settings.hold_out_rays
        part = aimed_rays.INSET / 2 + (1 - aimed_rays.INSET) * rng.random((count, 3))
        part[np.arange(count), rng.integers(0, 3, count)] = np.where(
            rng.random(count) < 0.5, aimed_rays.INSET / 2, 1 - aimed_rays.INSET / 2
        )
        starts = lo + (hi - lo) * part
        missed = aimed_rays.count_misses(
            self._standing(places), self._standing(reported), self._panes(places[~drawn[places]]), drawn, starts,
            rng.normal(size=(count, 3)),
        )  # fmt: skip
        return int(missed)
