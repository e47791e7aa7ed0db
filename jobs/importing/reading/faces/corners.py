"""Corners of faces: polygons become triangles, and corners with properties of their own become vertices."""

from __future__ import annotations

import numpy as np

from jobs.importing.reading.equal_rows import first_equal
from jobs.importing.reading.source_scene import SourceMesh


def fan(counts: np.ndarray) -> np.ndarray:
    """Corner numbers (m, 3) of the triangles that fan polygons out; polygons of `counts` corners lie one after another.

    Polygons with fewer than three corners give no triangle.
    """
    counts = np.asarray(counts, np.int64)
    starts = np.cumsum(counts) - counts
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(starts, triangles)
    number = np.arange(len(first), dtype=np.int64) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + number + 1, first + number + 2], axis=1)


def strips(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Corner numbers (m, 3) int64 of the triangles of strips of `counts` (s,) corners from corners `starts` (s,) on.

    Every other triangle is turned, so that all wind as the strip's first one does.
    """
    triangles = np.maximum(np.asarray(counts, np.int64) - 2, 0)
    number = np.arange(int(triangles.sum())) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    first = np.repeat(np.asarray(starts, np.int64), triangles) + number
    odd = number % 2
    return np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)


def unify(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners with equal keys become one vertex.

    `keys` (c, k) of 8-byte items. Returns the corner that each vertex is made of (n,), and each corner's vertex (c,);
    both int64. Vertices are in the order of their first corner.
    """
    first = first_equal(np.ascontiguousarray(keys))
    kept = np.flatnonzero(first == np.arange(len(first)))
    number = np.empty(len(first), np.int64)
    number[kept] = np.arange(len(kept))
    return kept, number[first]


def split_by_face(mesh: SourceMesh, colours: np.ndarray) -> None:
    """Give a mesh its triangles' colours (m, 4) uint8, with vertices split where they meet."""
    flat = mesh.triangles.reshape(-1)
    valid = (flat >= 0) & (flat < len(mesh.positions))
    packed = np.ascontiguousarray(np.repeat(colours, 3, axis=0)).view(np.uint32)[:, 0]
    kept, vertex = unify(np.stack([np.where(valid, flat, -1), packed.astype(np.int64)], axis=1))
    source = np.where(valid, flat, 0)[kept]
    mesh.positions = mesh.positions[source] if len(mesh.positions) else np.zeros((len(kept), 3))
    if mesh.normals is not None:
        mesh.normals = mesh.normals[source]
    mesh.colours = np.ascontiguousarray(packed[kept, None]).view(np.uint8)
    mesh.triangles = np.where(valid, vertex, -1).reshape(-1, 3)
