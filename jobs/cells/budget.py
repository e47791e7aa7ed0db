"""The most triangles that a cell may report, or its cut may have: how coarse it must be where it cannot be split.

The allowed error is raised step by step: 1, 1.5, 2, 3, 4, 6, 8 ... times the one asked for. The cell remembers it, so
that a reader of the store chooses the very same cut. Beyond hundreds of pixels even what touches the cell becomes
coarser (`storage.model.cut.choose_cut`), down to the coarsest level of the whole model, so some step always suffices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jobs.visibility.engine import CellVisibility
from storage.base.errors import ParameterError
from storage.geometry_reader import Geometry
from storage.model.cut import coarsest_triangles


@dataclass(frozen=True)
class Coarsened:
    """A cell at an allowed error at which it reports few enough triangles."""

    step: int  # of the ladder
    pixel_error: float  # in pixels, exactly as float32 holds it
    cut: np.ndarray  # (c,) int64 sorted ids
    found: CellVisibility


def check_budget(store: Geometry, most: int | None) -> None:
    """Raises ParameterError where even the coarsest levels of the model have more than `most` triangles."""
    least = coarsest_triangles(store.nodes, store.drawables)
    if most is not None and least > most:
        raise ParameterError(
            f"no cell can report as few as {most} triangles: the whole model at its coarsest has {least}: allow "
            f"--max-triangles {least} or more"
        )


def raised_error(pixel_error: float, step: int) -> float:
    """The allowed error in pixels at a step of the ladder, as float32 holds it; step 0: `pixel_error` itself."""
    return float(np.float32(pixel_error) * np.float32(1.5 if step % 2 else 1.0) * np.float32(2.0 ** (step // 2)))


def coarsen(
    cut_at: Callable[[float], np.ndarray],
    triangles_of: Callable[[np.ndarray], int],
    look: Callable[[np.ndarray], CellVisibility | None],
    pixel_error: float,
    most: int | None,
    expected: int = 1,
    most_held: int | None = None,
) -> Coarsened:
    """The cell at a low step of the ladder at which it reports no more than `most` triangles, of a cut of `most_held`.

    Between step 0, or the last one whose cut cannot be held, and the first step whose whole cut is small enough: first
    the expected step and the one beside it, then by bisection. The step below the result was tried and reports too
    many, or could not be tried.

    Args:
        cut_at: the cell's cut at an allowed error in pixels.
        triangles_of: how many triangles a cut has.
        look: what can be seen of a cut; None where that is more than `most` triangles.
        pixel_error: the allowed error of step 0.
        most: what `check_budget` found possible; None: any number.
        expected: a step that may well be the result.
        most_held: triangles of the largest cut that may be looked at, at least those of the coarsest; None: any number.
    """
    holds = 1
    cut = cut_at(raised_error(pixel_error, holds))
    while most_held is not None and triangles_of(cut) > most_held:
        holds += 1
        cut = cut_at(raised_error(pixel_error, holds))
    too_many = holds - 1
    while most is not None and triangles_of(cut) > most:
        holds += 1
        cut = cut_at(raised_error(pixel_error, holds))
    found: CellVisibility | None = None
    tried = 0
    while holds - too_many > 1:
        middle = (too_many + holds) // 2
        if tried < 2:
            near = expected if not tried else (holds - 1 if found is not None else too_many + 1)
            middle = min(max(near, too_many + 1), holds - 1)
        tried += 1
        middle_cut = cut_at(raised_error(pixel_error, middle))
        seen = look(middle_cut)
        if seen is None:
            too_many = middle
        else:
            holds, cut, found = middle, middle_cut, seen
    if found is None:
        found = look(cut)
        assert found is not None, "a cut is never smaller than what can be seen of it"
    return Coarsened(holds, raised_error(pixel_error, holds), cut, found)
