"""The cut of a cell stands for the whole model, fine enough, and the cell's vLOD is part of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jobs.checking.findings import Problems
from jobs.checking.workers import Place
from storage.base.errors import StoreError
from storage.model.cut import UNBOUNDED


def check_detail(place: Place, cell: int) -> Problems:
    """Checks one cell: each leaf stood for exactly once, errors, and the number of triangles that are turned away."""
    problems = Problems()
    try:
        problems.note(_faults(place, cell))
    except StoreError as error:
        problems.note([f"cell {cell} cannot be checked: {error}"])
    return problems


def _faults(place: Place, cell: int) -> Iterator[str]:
    """What is wrong with a cell, one line each."""
    store = place.store
    cut, vlod = store.cut(cell), store.vlod(cell)
    beyond = len(np.setdiff1d(vlod, cut, assume_unique=True))
    if beyond:
        yield f"cell {cell}: {beyond} drawables of its vLOD are not in its cut"
    rows = store.drawables[cut]
    end = store.nodes["end"].astype(np.int64)
    leaf = end == np.arange(len(end)) + 1
    covered = np.zeros(len(end) + 1, np.int64)
    np.add.at(covered, rows["node"], 1)
    np.add.at(covered, end[rows["node"]], -1)
    if (np.cumsum(covered)[:-1][leaf] != 1).any():
        yield f"cell {cell}: its cut does not stand for every leaf exactly once"
    row = store.cells[cell]
    turned = int(place.turned.of(vlod, row["lo"], row["hi"]).sum())
    if turned != row["turned_triangles"]:
        yield f"cell {cell}: {turned} triangles of its vLOD are turned away, the table says {row['turned_triangles']}"
    # from anywhere in the cell a point of the drawable is at least this far away
    gap = np.maximum(rows["lo"].astype(np.float64) - row["hi"], row["lo"] - rows["hi"].astype(np.float64)).clip(min=0)
    distance = np.sqrt((gap * gap).sum(axis=1))
    error = rows["error"].astype(np.float64)
    # beyond UNBOUNDED, which only a cell that is kept small reaches, near things may be coarser
    angle = float(row["pixel_error"]) * store.manifest.pixel_angle
    allowed = np.maximum(angle * distance, (angle - UNBOUNDED) * np.linalg.norm(row["hi"] - row["lo"]))
    coarse = ((rows["level"] > 0) | ~leaf[rows["node"]]) & (error > allowed * (1 + 1e-6))
    for d in cut[coarse].tolist():
        yield f"cell {cell}: drawable {d} is too coarse for the allowed {row['pixel_error']} pixels"
