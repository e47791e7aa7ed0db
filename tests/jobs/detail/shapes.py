"""Small meshes to simplify, and how to make a model of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jobs.detail.bounds.closest import Surface, make_surface
from jobs.detail.detail_options import DetailOptions
from jobs.detail.leaf import SHARED_LEVELS, Member, gather, make_leaf
from jobs.detail.node import Level, Node, Offer
from jobs.detail.pieces import make_pieces
from jobs.importing.keeping.saved import MeshView, Part, write_model
from jobs.importing.model import Model, open_model
from jobs.objects.object_options import Limits
from jobs.objects.weld import twins

Shape = tuple[np.ndarray, np.ndarray]


def surface_of(points: np.ndarray, triangles: np.ndarray) -> Surface:
    """Triangles (m, 3) over points (n, 3), ready for queries."""
    triangles = np.ascontiguousarray(triangles, np.int32)
    return make_surface(np.ascontiguousarray(points, np.float64), triangles, twins(triangles))


def grid(n: int, height: np.ndarray) -> Shape:
    """An open sheet of n x n points over the unit square, height (n, n); 2 (n - 1)^2 triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    points = np.stack([x.ravel(), y.ravel(), height.ravel()], axis=1)
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _closed(u: int, v: int, position: np.ndarray) -> Shape:
    """A torus-like patch of u x v points, closed in both directions; position (u, v, 3)."""
    i = np.arange(u * v).reshape(u, v)
    a, b = i.ravel(), np.roll(i, -1, 0).ravel()
    c, d = np.roll(np.roll(i, -1, 0), -1, 1).ravel(), np.roll(i, -1, 1).ravel()
    return position.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def torus(u: int = 48, v: int = 24, large: float = 1.0, small: float = 0.4) -> Shape:
    """A torus, wound outward."""
    s, t = np.meshgrid(np.arange(u) * 2 * np.pi / u, np.arange(v) * 2 * np.pi / v, indexing="ij")
    ring = large + small * np.cos(t)
    return _closed(u, v, np.stack([ring * np.cos(s), ring * np.sin(s), small * np.sin(t)], axis=-1))


def sphere(n: int = 16, radius: float = 1.0, bumps: float = 0.0) -> Shape:
    """A cube of 6 n x n quads blown up to a sphere, wound outward; bumps: relative height of waves."""
    step = np.tan((np.arange(n + 1) / n - 0.5) * np.pi / 2)
    s, t = np.meshgrid(step, step, indexing="ij")
    points: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    for axis in range(3):
        for side in (1.0, -1.0):
            face = np.zeros((n + 1, n + 1, 3))
            face[..., axis], face[..., (axis + 1) % 3], face[..., (axis + 2) % 3] = side, s * side, t
            _, own = grid(n + 1, s)
            triangles.append(own + len(points) * (n + 1) ** 2)
            points.append(face.reshape(-1, 3))
    p = np.concatenate(points)
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    p = np.round(p, 12)
    waves = np.sin(9 * p[:, 0]) * np.sin(8 * p[:, 1] + 1) * np.sin(7 * p[:, 2] + 2)
    return p * radius * (1 + bumps * waves)[:, None], np.concatenate(triangles)


def box(lo: tuple[float, float, float] = (0, 0, 0), hi: tuple[float, float, float] = (1, 1, 1)) -> Shape:
    """A box of 12 triangles, wound outward."""
    x = np.array([lo, hi], float)
    points = np.array([[x[i, 0], x[j, 1], x[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def joined(shapes: list[Shape]) -> Shape:
    """Several meshes as one."""
    starts = np.cumsum([0] + [len(p) for p, _ in shapes])
    return (
        np.concatenate([p for p, _ in shapes]),
        np.concatenate([t + start for (_, t), start in zip(shapes, starts[:-1], strict=True)]),
    )


def model_of(folder: Path, *shapes: Shape, placements: list[Part] | None = None, **extra: np.ndarray) -> Model:
    """A model of one mesh per shape, each placed as it is unless `placements` says otherwise."""
    write_model(folder / "model", [MeshView.of(p, t, **extra) for p, t in shapes], placements)
    return open_model(folder / "model")


@dataclass(frozen=True)
class Built:
    """A leaf made of one piece, in the piece's own space."""

    mesh: int
    node: Node
    offers: list[Offer]

    @property
    def scale(self) -> float:
        return self.node.scale

    @property
    def levels(self) -> tuple[Level, ...]:
        return self.node.levels


def leaves_of(model: Model, crease_angle: float = 40.0, most: int = 10_000) -> list[Built]:
    """All pieces of a model, of at most that many triangles, each as a leaf by itself."""
    options = DetailOptions(Limits(triangles=most, most=most), crease_angle)
    found = make_pieces(model, range(len(model.meshes)), options)
    leaves = []
    for number, row in enumerate(found.pieces):
        scale = float(row["scale"])
        patch = gather(model, [Member(found, number, 0, None, 1.0, None)], scale, -1)
        assert patch is not None
        leaf = make_leaf(patch, scale, float(np.cos(np.deg2rad(crease_angle))), SHARED_LEVELS)
        leaves.append(Built(int(row["mesh"]), leaf.node, leaf.offers))
    return leaves


def original(model: Model, leaf: Built) -> Shape:
    """The float64 triangles that a leaf's finest level stands for (source faces must be numbered in order)."""
    view = model.mesh(leaf.mesh)
    faces = leaf.levels[0].source_faces
    assert faces is not None
    rows = np.searchsorted(view.source_faces, faces[:, 1])
    return np.asarray(view.positions), np.asarray(view.triangles)[rows].astype(np.int64)


def level_mesh(leaf: Built, level: int) -> Shape:
    """A level's float64 positions in local units, and triangles."""
    return leaf.levels[level].positions * leaf.scale, leaf.levels[level].triangles.astype(np.int64)
