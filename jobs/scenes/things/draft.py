"""What all demo scenes share: a palette, a stock of things that are placed many times, and a budget of triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jobs.scenes.things.glb import GlbWriter
from jobs.scenes.things.solids import Mesh

Progress = Callable[[int, int], None]
Recipe = Callable[[], list[tuple[Mesh, str]]]  # makes the (mesh, material name) pairs of one thing
Point = tuple[float, float, float]

EYE_HEIGHT = 1.7  # metres above the floor

PALETTE: dict[str, tuple[tuple[float, float, float], float, float]] = {  # base colour, metallic, roughness
    "aluminium": ((0.78, 0.79, 0.80), 0.8, 0.35),
    "asphalt": ((0.23, 0.23, 0.25), 0.0, 0.95),
    "bark": ((0.36, 0.26, 0.18), 0.0, 0.9),
    "black": ((0.09, 0.09, 0.10), 0.0, 0.5),
    "blue": ((0.16, 0.33, 0.58), 0.1, 0.5),
    "brick": ((0.62, 0.33, 0.25), 0.0, 0.9),
    "brass": ((0.75, 0.60, 0.30), 0.8, 0.4),
    "carpet": ((0.38, 0.42, 0.48), 0.0, 1.0),
    "carpet light": ((0.55, 0.57, 0.56), 0.0, 1.0),
    "ceramic": ((0.93, 0.93, 0.91), 0.0, 0.3),
    "concrete": ((0.66, 0.65, 0.62), 0.0, 0.9),
    "cream": ((0.90, 0.85, 0.74), 0.0, 0.8),
    "dark concrete": ((0.47, 0.47, 0.46), 0.0, 0.9),
    "fabric blue": ((0.20, 0.29, 0.43), 0.0, 1.0),
    "fabric red": ((0.58, 0.20, 0.18), 0.0, 1.0),
    "galvanised": ((0.63, 0.66, 0.68), 0.6, 0.5),
    "glow": ((1.0, 0.97, 0.86), 0.0, 0.4),
    "grass": ((0.36, 0.50, 0.24), 0.0, 1.0),
    "green": ((0.22, 0.46, 0.31), 0.1, 0.5),
    "grey": ((0.50, 0.52, 0.54), 0.1, 0.6),
    "insulation": ((0.82, 0.83, 0.84), 0.7, 0.35),
    "leaf": ((0.25, 0.42, 0.18), 0.0, 0.9),
    "leaf light": ((0.40, 0.53, 0.22), 0.0, 0.9),
    "light grey": ((0.76, 0.77, 0.78), 0.0, 0.7),
    "marking": ((0.92, 0.92, 0.88), 0.0, 0.8),
    "ochre": ((0.80, 0.60, 0.30), 0.0, 0.8),
    "orange": ((0.88, 0.45, 0.14), 0.1, 0.5),
    "paper": ((0.95, 0.94, 0.90), 0.0, 0.9),
    "pavement": ((0.60, 0.59, 0.57), 0.0, 0.95),
    "plaster": ((0.92, 0.91, 0.88), 0.0, 0.9),
    "red": ((0.70, 0.16, 0.13), 0.1, 0.5),
    "rubber": ((0.13, 0.13, 0.14), 0.0, 0.9),
    "sandstone": ((0.79, 0.71, 0.57), 0.0, 0.9),
    "screen": ((0.12, 0.17, 0.24), 0.0, 0.15),
    "slate": ((0.33, 0.36, 0.40), 0.0, 0.8),
    "steel": ((0.42, 0.48, 0.55), 0.5, 0.5),
    "teal": ((0.17, 0.45, 0.48), 0.1, 0.5),
    "terracotta": ((0.71, 0.40, 0.27), 0.0, 0.9),
    "white": ((0.94, 0.94, 0.93), 0.0, 0.6),
    "wood": ((0.68, 0.49, 0.31), 0.0, 0.7),
    "wood dark": ((0.42, 0.28, 0.18), 0.0, 0.7),
    "yellow": ((0.92, 0.74, 0.16), 0.1, 0.5),
}


@dataclass(frozen=True)
class Walk:
    """Where a person can be in a scene; all points at eye height, z up, in metres."""

    viewpoints: NDArray[np.float64]  # (n, 3)
    tour: NDArray[np.float64]  # (m, 3) way points; the straight legs between them meet no wall


@dataclass(frozen=True)
class SceneKind:
    """How one kind of scene is made: the SCENE of its module, which `jobs.scenes.kinds` lists."""

    build: Callable[[SceneDraft, int, int], None]  # draft, triangles, seed
    walk: Callable[[int, int], Walk]  # triangles, seed
    recipes: dict[str, Recipe]


@dataclass
class SceneDraft:
    """A scene in the making: the file, the triangles asked for, and what can be placed."""

    writer: GlbWriter
    target: int  # triangles asked for, instances counted each time
    recipes: dict[str, Recipe]
    progress: Progress | None = None
    _materials: dict[str, int] = field(default_factory=dict)
    _stock: dict[str, int] = field(default_factory=dict)
    _costs: dict[str, int] = field(default_factory=dict)

    @property
    def left(self) -> int:
        """Triangles still to be placed."""
        return self.target - self.writer.triangles

    def material(self, name: str) -> int:
        """The index of a material of the palette."""
        if name not in self._materials:
            colour, metal, rough = PALETTE[name]
            self._materials[name] = self.writer.material(name, colour, metal, rough)
        return self._materials[name]

    def cost(self, thing: str) -> int:
        """Triangles of a thing of the stock."""
        if thing not in self._costs:
            self._costs[thing] = sum(mesh.count for mesh, _ in self.recipes[thing]())
        return self._costs[thing]

    def put(
        self, name: str, thing: str, at: Point, turn: NDArray[np.float64] | None = None, scale: float = 1.0
    ) -> None:
        """Place a thing of the stock; its mesh is written when it is first needed."""
        if thing not in self._stock:
            pairs = [(mesh, self.material(material)) for mesh, material in self.recipes[thing]()]
            self._stock[thing] = self.writer.mesh(thing, pairs)
        self.writer.place(name, self._stock[thing], at, turn, scale)

    def add(self, name: str, mesh: Mesh, material: str) -> None:
        """Write a mesh of its own, unless it is empty, and place it where it is."""
        if mesh.count:
            self.writer.add(name, mesh, self.material(material))

    def report(self) -> None:
        """Tell the progress callback how far the scene is."""
        if self.progress is not None:
            self.progress(min(self.writer.triangles, self.target), self.target)
