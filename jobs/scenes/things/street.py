"""What stands in streets and on roofs: trees, cars, lamps, benches. Each stands at the origin, z up, facing -y."""

from __future__ import annotations

from functools import partial

import numpy as np

from jobs.scenes.things.draft import Recipe
from jobs.scenes.things.furnishings import Pairs, blocks
from jobs.scenes.things.solids import Mesh, blob, boxes, cylinders, frames_along, join, lathe, prisms, tubes, vec

_ACROSS = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])  # outlines in x and z, pushed along -y


def tree(variant: int) -> Pairs:
    """A tree of 5 to 8 m."""
    rng = np.random.default_rng([21, variant])
    high = (5.5, 6.5, 8.0)[variant]
    trunk = lathe([[0, -0.2], [0.24, -0.2], [0.16, 0.4], [0.13, high * 0.5], [0.05, high * 0.8], [0, high * 0.8]], 10)
    yaw = rng.uniform(0, 2 * np.pi) + np.arange(4) * 1.7
    low = np.stack([np.zeros(4), np.zeros(4), high * np.linspace(0.36, 0.5, 4)], axis=1)
    tip = low + np.stack([np.cos(yaw) * 1.1, np.sin(yaw) * 1.1, np.full(4, 0.9)], axis=1)
    branches = cylinders(low, tip, 0.06, 6)
    crowns = [blob((1.5, 1.5, 1.25), 0.14, 2, rng).moved(0, 0, high * 0.78)]
    crowns += [blob((1.0, 1.0, 0.85), 0.16, 1, rng).moved(*(tip[k] + (0, 0, 0.3)).tolist()) for k in range(4)]
    return [(join([trunk, branches]), "bark"), (join(crowns), ("leaf", "leaf light", "leaf")[variant])]


def conifer() -> Pairs:
    """A fir of 7 m."""
    trunk = lathe([[0, -0.2], [0.16, -0.2], [0.1, 2.0], [0, 2.0]], 10)
    skirts = [
        lathe([[0, z], [r, z - 0.25], [r * 0.35, z + 0.8], [0, z + 1.3]], 18)
        for r, z in ((1.5, 1.3), (1.3, 2.3), (1.1, 3.3), (0.85, 4.3), (0.55, 5.3))
    ]
    return [(trunk, "bark"), (join(skirts), "leaf")]


def _wheels(xs: tuple[float, ...], half: float) -> Mesh:
    tyre = lathe(
        [[0, -0.1], [0.2, -0.1], [0.22, -0.12], [0.34, -0.1], [0.34, 0.1], [0.22, 0.12], [0.2, 0.1], [0, 0.1]], 14
    )
    return join([tyre.turned([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).moved(x, y, 0.34) for x in xs for y in (-half, half)])


def car(paint: str, van: bool) -> Pairs:
    """A car along x, 4.3 m long, its front towards +x."""
    body = [[-2.1, 0.3], [2.05, 0.3], [2.15, 0.45], [2.1, 0.7], [1.95, 0.82], [-2.05, 0.95], [-2.15, 0.7]]
    cabin = (
        [[-1.95, 0.9], [1.15, 0.84], [0.35, 1.42], [-1.2, 1.46]]
        if not van
        else [[-2.05, 0.9], [1.5, 0.84], [1.0, 1.75], [-2.0, 1.8]]
    )
    roof = (
        [[-1.2, 1.45], [0.36, 1.41], [0.3, 1.47], [-1.15, 1.51]]
        if not van
        else [[-2.0, 1.79], [1.0, 1.74], [0.9, 1.83], [-1.95, 1.88]]
    )
    shell = prisms(body, [[0, 0.86, 0]], _ACROSS, [1.72])
    glass = prisms(cabin, [[0, 0.74, 0]], _ACROSS, [1.48])
    top = prisms(roof, [[0, 0.76, 0]], _ACROSS, [1.52])
    x = (-0.45,) if not van else (-0.9, 0.3)
    pillars = blocks(*[(p, y, 0.85, 0.09, 0.03, 0.58 if not van else 0.92) for p in x for y in (-0.745, 0.745)])
    bumpers = blocks((2.13, 0, 0.34, 0.12, 1.6, 0.16), (-2.13, 0, 0.34, 0.12, 1.6, 0.16))
    lamps = blocks((2.09, -0.62, 0.6, 0.1, 0.3, 0.12), (2.09, 0.62, 0.6, 0.1, 0.3, 0.12))
    rear = blocks((-2.12, -0.66, 0.66, 0.08, 0.28, 0.14), (-2.12, 0.66, 0.66, 0.08, 0.28, 0.14))
    return [
        (join([shell, top, pillars]), paint),
        (glass, "screen"),
        (join([_wheels((-1.35, 1.35), 0.78), bumpers]), "rubber"),
        (lamps, "glow"),
        (rear, "red"),
    ]


def street_lamp() -> Pairs:
    """A lamp 6 m high that reaches over the street towards -y."""
    pole = tubes([[[0, 0, 0], [0, 0, 6.0], [0, -1.6, 6.3]]], [0.06], 6.0, 10, 5)
    foot = lathe([[0, 0], [0.14, 0], [0.12, 0.9], [0.07, 1.0], [0, 1.0]], 12)
    head = blocks((0, -1.75, 6.24, 0.26, 0.7, 0.12))
    return [(join([pole, foot, head]), "slate"), (blocks((0, -1.75, 6.2, 0.2, 0.6, 0.05)), "glow")]


def bench() -> Pairs:
    """A bench; whoever sits on it looks to -y."""
    slats = blocks(
        *[(0, -0.18 + 0.12 * k, 0.44, 1.8, 0.09, 0.035) for k in range(4)],
        *[(0, 0.27, 0.58 + 0.14 * k, 1.8, 0.035, 0.1) for k in range(3)],
    )
    legs = blocks(
        *[(x, y, 0, 0.06, 0.06, 0.44) for x in (-0.75, 0.75) for y in (-0.15, 0.18)],
        *[(x, 0.3, 0.3, 0.06, 0.04, 0.68) for x in (-0.75, 0.75)],
    )
    return [(slats, "wood"), (legs, "black")]


def litter_bin() -> Pairs:
    """A litter bin on a post."""
    return [
        (lathe([[0, 0.1], [0.22, 0.1], [0.26, 0.8], [0.24, 0.85], [0.2, 0.85], [0.18, 0.3], [0, 0.3]], 20), "green"),
        (blocks((0, 0, 0, 0.08, 0.08, 0.2)), "black"),
    ]


def air_conditioner() -> Pairs:
    """A roof unit."""
    fan = [lathe([[0.5, 1.1], [0.56, 1.1], [0.56, 1.24], [0.5, 1.24], [0.5, 1.1]], 24).moved(x) for x in (-0.65, 0.65)]
    blades = blocks(
        *[(x, 0, 1.12, 0.9, 0.1, 0.02) for x in (-0.65, 0.65)], *[(x, 0, 1.14, 0.1, 0.9, 0.02) for x in (-0.65, 0.65)]
    )
    louvres = blocks(*[(0, y, 0.25 + 0.1 * k, 2.3, 0.04, 0.04) for y in (-0.71, 0.71) for k in range(8)])
    return [
        (join([blocks((0, 0, 0.15, 2.6, 1.4, 0.95)), *fan, louvres]), "light grey"),
        (join([blades, blocks((-1, 0, 0, 0.1, 1.3, 0.15), (1, 0, 0, 0.1, 1.3, 0.15))]), "slate"),
    ]


def water_tank() -> Pairs:
    """A wooden tank on a roof."""
    shell = lathe([[0, 1.6], [1.3, 1.6], [1.25, 3.8], [0, 4.6]], 28)
    hoops = [
        lathe([[1.2, z], [1.33, z], [1.33, z + 0.06], [1.2, z + 0.06], [1.2, z]], 28) for z in (1.8, 2.4, 3.0, 3.5)
    ]
    legs = blocks(
        *[(x, y, 0, 0.14, 0.14, 1.5) for x in (-0.85, 0.85) for y in (-0.85, 0.85)], (0, 0, 1.45, 2.4, 2.4, 0.15)
    )
    return [(shell, "wood dark"), (join([*hoops, legs]), "steel")]


def balcony() -> Pairs:
    """A balcony 2.5 m wide before a wall at y = 0, its floor at z = 0."""
    slab = blocks((0, -0.6, -0.18, 2.5, 1.2, 0.16))
    x = np.linspace(-1.2, 1.2, 19)
    y = np.linspace(-1.1, -0.15, 7)
    at = np.concatenate(
        [np.stack([x, np.full(19, -1.15)], 1), np.stack([np.full(7, -1.2), y], 1), np.stack([np.full(7, 1.2), y], 1)]
    )
    low = np.concatenate([at, np.full((33, 1), -0.02)], axis=1)
    bars = boxes(low - vec(0.008, 0.008, 0), low + vec(0.008, 0.008, 1.0))
    rail = blocks(
        (0, -1.15, 0.98, 2.45, 0.05, 0.05), (-1.2, -0.57, 0.98, 0.05, 1.12, 0.05), (1.2, -0.57, 0.98, 0.05, 1.12, 0.05)
    )
    return [(slab, "concrete"), (join([bars, rail]), "black")]


def fountain() -> Pairs:
    """A round basin with a bowl."""
    wall = lathe([[3.2, 0], [3.6, 0], [3.6, 0.5], [3.2, 0.5], [3.2, 0]], 48)
    bowl = lathe(
        [[0, 0], [0.5, 0], [0.25, 0.4], [0.22, 1.1], [1.2, 1.5], [1.15, 1.55], [0.2, 1.3], [0.1, 2.0], [0, 2.0]], 36
    )
    return [(join([wall, bowl]), "sandstone"), (lathe([[0, 0.02], [3.22, 0.02], [3.22, 0.38], [0, 0.38]], 48), "teal")]


def crossing() -> Pairs:
    """The stripes of a pedestrian crossing, 4 m long along y, over a street 12 m wide along x."""
    return [(blocks(*[(-5.25 + 1.0 * k, 0, 0.0, 0.5, 3.0, 0.012) for k in range(12)]), "marking")]


def dashes() -> Pairs:
    """A broken line of 40 m along x."""
    return [(blocks(*[(-18.0 + 4.0 * k, 0, 0.0, 2.0, 0.15, 0.012) for k in range(10)]), "marking")]


def awning() -> Pairs:
    """A striped awning 2.4 m wide before a wall at y = 0, its top at z = 0."""
    outline = [[-1.3, -0.7], [-1.3, -0.85], [-1.26, -0.85], [-1.26, -0.68], [0.0, -0.04], [0.0, 0.0]]
    axes = frames_along([[1.0, 0.0, 0.0]])
    red: list[Mesh] = []
    white: list[Mesh] = []
    for k in range(8):
        strip = prisms(outline, [[-1.2 + 0.3 * k, 0, 0]], axes, [0.3])
        (red if k % 2 else white).append(strip)
    return [(join(red), "red"), (join(white), "white")]


RECIPES: dict[str, Recipe] = {
    "air conditioner": air_conditioner,
    "awning": awning,
    "balcony": balcony,
    "bench": bench,
    **{f"car {paint}": partial(car, paint, False) for paint in ("blue", "grey", "red", "white", "black")},
    "conifer": conifer,
    "crossing": crossing,
    "dashes": dashes,
    "fountain": fountain,
    "litter bin": litter_bin,
    "street lamp": street_lamp,
    **{f"tree {k}": partial(tree, k) for k in range(3)},
    **{f"van {paint}": partial(car, paint, True) for paint in ("ochre", "white", "teal")},
    "water tank": water_tank,
}
