"""Plant equipment: recipes for what is placed many times (flange, valve, pump); tanks and vessels made to measure."""

from __future__ import annotations

import numpy as np

from jobs.scenes.things.draft import Recipe
from jobs.scenes.things.furnishings import Pairs, blocks
from jobs.scenes.things.solids import (
    Floats,
    Mesh,
    boxes,
    copies,
    cylinders,
    frames_along,
    join,
    lathe,
    prisms,
    ring,
    tubes,
    turn_z,
    turned_boxes,
    vec,
)

X_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # turns z to x, x to y, y to z


def flange() -> Pairs:
    """A pair of flanges about a pipe of radius 1 along z, with bolts."""
    profile = [[0, -0.3], [1.9, -0.3], [1.9, -0.03], [1.3, -0.03], [1.3, 0.03], [1.9, 0.03], [1.9, 0.3], [0, 0.3]]
    angle = np.arange(6) * (np.pi / 3)
    bolts = blocks(*[(1.58 * np.cos(a), 1.58 * np.sin(a), -0.42, 0.24, 0.24, 0.84) for a in angle.tolist()])
    return [(lathe(profile, 16), "steel"), (bolts, "brass")]


def valve() -> Pairs:
    """A gate valve for a pipe of radius 1 along x; its hand wheel is up."""
    body = lathe(
        [
            [0, -3.2],
            [1.9, -3.2],
            [1.9, -2.8],
            [1.2, -2.8],
            [1.2, -1.5],
            [1.7, -0.7],
            [1.7, 0.7],
            [1.2, 1.5],
            [1.2, 2.8],
            [1.9, 2.8],
            [1.9, 3.2],
            [0, 3.2],
        ],
        14,
    ).turned(X_UP)
    bonnet = lathe([[0, 0], [1.1, 0], [1.1, 2.2], [1.6, 2.2], [1.6, 2.7], [0.7, 2.9], [0.4, 4.6], [0, 4.6]], 12)
    stem = cylinders([[0, 0, 4.4]], [[0, 0, 6.4]], 0.2, 8)
    wheel = join(
        [
            ring(2.0, 0.22, 20, 5).moved(0, 0, 5.8),
            cylinders([[-1.9, 0, 5.8], [0, -1.9, 5.8]], [[1.9, 0, 5.8], [0, 1.9, 5.8]], 0.14, 6),
        ]
    )
    return [(join([body, bonnet, stem]), "blue"), (wheel, "red")]


def pump() -> Pairs:
    """A pump with its motor on a base plate; its discharge is at (-0.25, 0.45, 0.95) and faces y."""
    base = blocks((0.25, 0, 0, 1.6, 0.6, 0.12), (0.55, 0, 0.12, 0.5, 0.4, 0.15), (-0.25, 0, 0.12, 0.25, 0.3, 0.15))
    casing = (
        lathe([[0, -0.16], [0.2, -0.16], [0.32, -0.1], [0.34, 0], [0.32, 0.1], [0.2, 0.16], [0, 0.16]], 24)
        .turned(X_UP)
        .moved(-0.25, 0, 0.55)
    )
    suction = (
        lathe([[0, 0], [0.16, 0], [0.16, 0.03], [0.09, 0.03], [0.09, 0.3], [0, 0.3]], 20)
        .turned(X_UP)
        .moved(-0.55, 0, 0.55)
    )
    discharge = tubes([[[-0.25, 0.1, 0.55], [-0.25, 0.1, 0.95], [-0.25, 0.42, 0.95]]], [0.075], 2.0, 16, 5)
    collar = (
        lathe([[0, 0], [0.14, 0], [0.14, 0.03], [0, 0.03]], 20)
        .turned([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        .moved(-0.25, 0.42, 0.95)
    )
    shaft = (
        lathe([[0, 0], [0.05, 0], [0.05, 0.08], [0.11, 0.08], [0.11, 0.22], [0.05, 0.22], [0.05, 0.35], [0, 0.35]], 20)
        .turned(X_UP)
        .moved(-0.1, 0, 0.55)
    )
    motor = (
        lathe([[0, 0], [0.18, 0], [0.2, 0.04], [0.2, 0.62], [0.22, 0.63], [0.22, 0.74], [0.16, 0.8], [0, 0.8]], 20)
        .turned(X_UP)
        .moved(0.22, 0, 0.55)
    )
    angle = np.arange(16) * (2 * np.pi / 16)
    fins = turned_boxes(
        np.stack([np.full(16, 0.56), 0.215 * np.cos(angle), 0.55 + 0.215 * np.sin(angle)], axis=1),
        np.tile([0.26, 0.02, 0.006], (16, 1)),
        np.stack(
            [
                np.stack([np.full(16, 1.0), np.zeros(16), np.zeros(16)], 1),
                np.stack([np.zeros(16), np.cos(angle), np.sin(angle)], 1),
                np.stack([np.zeros(16), -np.sin(angle), np.cos(angle)], 1),
            ],
            axis=-1,
        ),
    )
    terminal = blocks((0.5, -0.24, 0.62, 0.2, 0.12, 0.18))
    return [
        (join([casing, suction, discharge, collar]), "teal"),
        (join([motor, fins, terminal]), "green"),
        (join([base]), "dark concrete"),
        (shaft, "aluminium"),
    ]


def grating() -> Pairs:
    """One square metre of bar grating, its top at z = 0, corner at the origin."""
    x = (np.arange(22) + 0.5) / 22
    bars = boxes(
        np.stack([x - 0.0025, np.full(22, 0.0), np.full(22, -0.035)], 1),
        np.stack([x + 0.0025, np.full(22, 1.0), np.zeros(22)], 1),
    )
    y = (np.arange(5) + 0.5) / 5
    rods = boxes(
        np.stack([np.full(5, 0.0), y - 0.004, np.full(5, -0.012)], 1),
        np.stack([np.full(5, 1.0), y + 0.004, np.full(5, -0.002)], 1),
    )
    return [(join([bars, rods]), "galvanised")]


def hall_lamp() -> Pairs:
    """A bell lamp that hangs from the origin."""
    shade = lathe([[0, -0.55], [0.16, -0.55], [0.28, -0.72], [0.3, -0.72], [0.18, -0.5], [0.1, -0.3], [0, -0.28]], 24)
    glass = lathe([[0, -0.7], [0.1, -0.68], [0.14, -0.56], [0, -0.54]], 16)
    return [(join([shade, cylinders([[0, 0, -0.3]], [[0, 0, 0]], 0.012, 6)]), "grey"), (glass, "glow")]


def roof_fan() -> Pairs:
    """A ventilator on a roof, standing at the origin."""
    curb = blocks((0, 0, 0, 1.4, 1.4, 0.4))
    hood = lathe([[0, 0.4], [0.55, 0.4], [0.55, 0.8], [0.75, 0.85], [0.75, 1.0], [0.4, 1.25], [0, 1.3]], 24)
    return [(curb, "dark concrete"), (hood, "galvanised")]


def gauge() -> Pairs:
    """A pressure gauge of unit size on a stub along z, its dial facing -y."""
    dial = (
        lathe([[0, -0.25], [1.0, -0.25], [1.1, -0.2], [1.1, 0.25], [0, 0.25]], 20)
        .turned([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        .moved(0, 0, 3.0)
    )
    return [(join([dial, cylinders([[0, 0, 0]], [[0, 0, 2.0]], 0.25, 8)]), "black")]


def cabinet() -> Pairs:
    """A switch cabinet, its back at y = 0, facing -y."""
    doors = blocks((-0.4, -0.51, 0.14, 0.76, 0.02, 1.8), (0.4, -0.51, 0.14, 0.76, 0.02, 1.8))
    lamps = [
        lathe([[0, 0], [0.02, 0], [0.015, 0.03], [0, 0.03]], 10)
        .turned([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        .moved(x, -0.52, 1.7)
        for x in (-0.5, -0.4, -0.3, 0.3, 0.4, 0.5)
    ]
    return [
        (join([blocks((0, -0.25, 0.1, 1.6, 0.5, 1.9), (0, -0.25, 0, 1.5, 0.4, 0.1)), doors]), "light grey"),
        (join(lamps), "orange"),
    ]


RECIPES: dict[str, Recipe] = {
    "flange": flange,
    "gauge": gauge,
    "grating": grating,
    "hall lamp": hall_lamp,
    "pump": pump,
    "roof fan": roof_fan,
    "switch cabinet": cabinet,
    "valve": valve,
}


# ------------------------------------------------------------------------------------------ made to measure


def _heads(radius: float, low: float, high: float, steps: int = 8) -> Floats:
    """The profile of a shell from `low` to `high` with elliptic heads of half the radius's depth beyond both."""
    angle = np.linspace(0.0, np.pi / 2, steps + 1)
    r, z = radius * np.sin(angle), radius / 2 * np.cos(angle)
    r[0] = 0.0
    bottom = np.stack([r, low - z], axis=1)
    top = np.stack([r, high + z], axis=1)[::-1]
    bottom[-1, 1], top[0, 1] = low, high
    return np.concatenate([bottom, top])


def tank(radius: float, height: float, sectors: int) -> Mesh:
    """A vertical tank with dished heads on a skirt, standing at the origin; the top head ends at `height`."""
    low = 0.4 + radius / 2
    shell = lathe(_heads(radius, low, height - radius / 2), sectors)
    skirt = lathe(
        [
            [radius * 0.85, 0.0],
            [radius * 1.08, 0.0],
            [radius * 1.08, 0.05],
            [radius * 0.98, 0.05],
            [radius * 0.98, low + 0.1],
            [radius * 0.85, low + 0.1],
            [radius * 0.85, 0.0],
        ],
        sectors,
    )
    bands = copies(
        ring(radius, 0.03, sectors, 6), [[0, 0, z] for z in np.linspace(low, height - radius / 2, 4).tolist()]
    )
    return join([shell, skirt, bands])


def nozzles(centre: Floats, radius: float, zs: Floats, degrees: Floats, bore: float) -> Mesh:
    """Blind nozzles sticking out of an upright shell about `centre` (3,) at heights `zs`."""
    angle = np.radians(degrees)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    start = centre + out * (radius - 0.05) + np.stack([np.zeros_like(zs), np.zeros_like(zs), zs], axis=1)
    faces = start + out * 0.2
    return cylinders(
        np.concatenate([start, faces]),
        np.concatenate([start + out * 0.25, faces + out * 0.07]),
        np.repeat([bore, bore * 1.7], len(zs)),
        18,
    )


def vessel(radius: float, length: float, sectors: int) -> tuple[Mesh, Mesh]:
    """A horizontal vessel along x, centred at the origin's x and y, on two saddles: shell and saddles."""
    middle = radius + 0.45
    shell = lathe(_heads(radius, -length / 2, length / 2), sectors).turned(X_UP).moved(0, 0, middle)
    wide = radius * 1.6
    outline = np.array(
        [
            [-wide / 2, 0],
            [wide / 2, 0],
            [wide / 2, middle * 0.85],
            [radius * 0.35, 0.5],
            [-radius * 0.35, 0.5],
            [-wide / 2, middle * 0.85],
        ]
    )
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    saddles = prisms(outline, [[x - 0.12, 0, 0] for x in (-length * 0.33, length * 0.33)], axes[None], [0.24, 0.24])
    return shell, saddles


def ladder(foot: Floats, height: float, degrees: float) -> Mesh:
    """A ladder from `foot` (3,) up; climbers look in direction `degrees`."""
    turn = turn_z(degrees)
    side = turn @ np.array([0.0, 0.22, 0.0])
    rungs = np.arange(0.3, height, 0.3)
    at = foot + np.stack([np.zeros_like(rungs), np.zeros_like(rungs), rungs], axis=1)
    top = vec(0, 0, height + 1.0)
    starts = np.concatenate([[foot - side, foot + side], at - side])
    ends = np.concatenate([[foot - side + top, foot + side + top], at + side])
    return cylinders(starts, ends, np.where(np.arange(len(starts)) < 2, 0.025, 0.012), 8)


def handrail(points: Floats) -> Mesh:
    """A railing with two rails, posts and a toe board along `points` (n, 3) at floor height."""
    first, last = points[:-1], points[1:]
    length = np.linalg.norm(last - first, axis=1)
    legs = zip(first, last, length.tolist(), strict=True)
    posts = [a + (b - a) * np.linspace(0.0, 1.0, max(2, round(long / 1.2) + 1))[:, None] for a, b, long in legs]
    at = np.unique(np.round(np.concatenate(posts), 6), axis=0)
    high, half = vec(0, 0, 1.1), vec(0, 0, 0.55)
    starts = np.concatenate([first + high, first + half, at])
    bars = cylinders(starts, np.concatenate([last + high, last + half, at + high]), 0.021, 10)
    middle = (first + last) / 2 + (0, 0, 0.07)
    halves = np.stack([np.full(len(first), 0.004), np.full(len(first), 0.06), length / 2], axis=1)
    toe = turned_boxes(middle, halves, frames_along(last - first))
    return join([bars, toe])


def gallery(centre: Floats, radius: float, high: float) -> tuple[Mesh, Mesh]:
    """A platform around an upright tank of `radius` about `centre` (3,) at height `high`: floor and railing."""
    inner, outer = radius + 0.01, radius + 0.95
    section = [[inner, high - 0.06], [outer, high - 0.06], [outer, high], [inner, high], [inner, high - 0.06]]
    angle = np.linspace(0.0, 2 * np.pi, 15)
    angle[-1] = 0.0
    edge = centre + np.stack(
        [np.cos(angle) * (outer - 0.05), np.sin(angle) * (outer - 0.05), np.full(15, high)], axis=1
    )
    brackets = np.arange(8) * (np.pi / 4)
    out = np.stack([np.cos(brackets), np.sin(brackets), np.zeros(8)], axis=1)
    low = centre + out * (radius - 0.02) + (0, 0, high - 0.9)
    struts = cylinders(low, low + out * 0.9 + (0, 0, 0.83), 0.03, 8)
    return join([lathe(section, 28).moved(*centre.tolist()), struts]), handrail(edge)


def stairs(foot: Floats, run: float, rise: float, wide: float, steps: int) -> tuple[Mesh, Mesh]:
    """An open steel stair from `foot` (3,) along +x: treads with stringers, and railings."""
    k = np.arange(steps)
    going, up = run / steps, rise / steps
    lo = foot + np.stack([k * going, np.full(steps, -wide / 2), (k + 1) * up - 0.04], axis=1)
    hi = foot + np.stack([(k + 1) * going + 0.03, np.full(steps, wide / 2), (k + 1) * up], axis=1)
    ends = np.array([[run / 2, y, rise / 2 - 0.08] for y in (-wide / 2 - 0.02, wide / 2 + 0.02)]) + foot
    slope = frames_along([[run, 0.0, rise]] * 2)
    stringers = turned_boxes(ends, [[0.012, 0.12, float(np.hypot(run, rise)) / 2]] * 2, slope)
    rails = []
    for y in (-wide / 2 - 0.02, wide / 2 + 0.02):
        low, high = foot + vec(0.1, y, 0.0), foot + vec(run, y, rise)
        rails.append(np.stack([low, low + vec(0, 0, 1.1), high + vec(0, 0, 1.1), high]))
    t = np.linspace(0.15, 0.85, 5)
    posts = np.concatenate([rail[0] + (rail[3] - rail[0]) * t[:, None] for rail in rails])
    mid = cylinders([rail[0] + (0, 0, 0.55) for rail in rails], [rail[3] + (0, 0, 0.55) for rail in rails], 0.018, 8)
    railing = join([tubes(np.stack(rails), 0.021, 3.0, 10, 4), cylinders(posts, posts + vec(0, 0, 1.1), 0.018, 8), mid])
    return join([boxes(lo, hi), stringers]), railing


def tray(x0: float, x1: float, y: float, z: float, wide: float, cables: Floats) -> tuple[Mesh, Mesh]:
    """A cable ladder along x with cables (k, 2): offset across and radius."""
    rungs = np.arange(x0 + 0.15, x1, 0.3)
    n = len(rungs)
    rails = boxes(
        [[x0, y - wide / 2 - 0.015, z], [x0, y + wide / 2, z]],
        [[x1, y - wide / 2, z + 0.1], [x1, y + wide / 2 + 0.015, z + 0.1]],
    )
    bars = boxes(
        np.stack([rungs - 0.015, np.full(n, y - wide / 2), np.full(n, z + 0.01)], 1),
        np.stack([rungs + 0.015, np.full(n, y + wide / 2), np.full(n, z + 0.03)], 1),
    )
    at = np.stack([np.full(len(cables), x0 + 0.05), y + cables[:, 0], z + 0.03 + cables[:, 1]], axis=1)
    end = at + vec(x1 - x0 - 0.1, 0, 0)
    return join([rails, bars]), cylinders(at, end, cables[:, 1], 8)
