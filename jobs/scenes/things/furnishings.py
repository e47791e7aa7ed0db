"""Furniture and fittings: each recipe makes one thing, standing on the floor at the origin and facing -y, z up."""

from __future__ import annotations

from functools import partial

import numpy as np

from jobs.scenes.things.draft import Recipe
from jobs.scenes.things.solids import (
    Mesh,
    beams,
    blob,
    boxes,
    cylinders,
    frames_along,
    join,
    lathe,
    prisms,
    ring,
    turn_z,
    turned_boxes,
)

Pairs = list[tuple[Mesh, str]]


def box(x: float, y: float, z: float, wide: float, deep: float, high: float) -> tuple[list[float], list[float]]:
    """Corners of a box centred at x, y whose underside is at z."""
    return [x - wide / 2, y - deep / 2, z], [x + wide / 2, y + deep / 2, z + high]


def blocks(*each: tuple[float, float, float, float, float, float]) -> Mesh:
    """Boxes given as x, y, z (underside), width, depth, height."""
    corners = [box(*item) for item in each]
    return boxes([lo for lo, _ in corners], [hi for _, hi in corners])


def desk() -> Pairs:
    """A desk 1.6 m wide; one sits on its -y side."""
    top = blocks((0, 0, 0.72, 1.6, 0.8, 0.03))
    legs = blocks(*[(x, y, 0, 0.05, 0.05, 0.72) for x in (-0.75, 0.75) for y in (-0.35, 0.35)])
    bars = blocks((0, 0.35, 0.64, 1.45, 0.03, 0.06), (0, 0.36, 0.30, 1.45, 0.015, 0.30))
    drawers = blocks(
        (0.52, 0.02, 0.08, 0.42, 0.6, 0.6), *[(0.52, -0.29, 0.1 + 0.19 * k, 0.38, 0.02, 0.17) for k in range(3)]
    )
    knobs = blocks(*[(0.52, -0.31, 0.18 + 0.19 * k, 0.12, 0.02, 0.015) for k in range(3)])
    return [(top, "wood"), (join([legs, bars, knobs]), "aluminium"), (drawers, "light grey")]


def chair() -> Pairs:
    """A swivel chair; whoever sits on it looks to -y."""
    angle = np.arange(5) * 72.0
    feet = join(
        [
            beams(
                [[0, 0, 0.09]], [[0.3, 0, 0.07]], [[-0.02, -0.015], [0.02, -0.015], [0.02, 0.015], [-0.02, 0.015]]
            ).turned(turn_z(a))
            for a in angle
        ]
    )
    castor = (
        lathe([[0, -0.02], [0.03, -0.02], [0.03, 0.02], [0, 0.02]], 12)
        .turned([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        .moved(0.3, 0, 0.03)
    )
    castors = join([castor.turned(turn_z(a)) for a in angle])
    post = lathe([[0, 0.05], [0.04, 0.05], [0.04, 0.1], [0.025, 0.12], [0.025, 0.42], [0.08, 0.43], [0, 0.43]], 16)
    cushion = np.array(
        [[-0.24, 0.0], [-0.2, -0.03], [0.2, -0.03], [0.24, 0.0], [0.25, 0.04], [0.2, 0.07], [-0.2, 0.07], [-0.25, 0.04]]
    )
    seat = prisms(cushion, [[0, 0.24, 0.46]], frames_along([[0, -1, 0]]), [0.48])
    back = prisms(cushion, [[0, 0.25, 0.60]], np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])[None], [0.5]).moved(
        0, 0.0, 0
    )
    spine = blocks((0, 0.31, 0.42, 0.08, 0.03, 0.4), (0, 0.2, 0.42, 0.08, 0.22, 0.03))
    arms = blocks(
        *[(x, 0.02, 0.66, 0.06, 0.28, 0.03) for x in (-0.29, 0.29)],
        *[(x, 0.02, 0.46, 0.03, 0.05, 0.2) for x in (-0.28, 0.28)],
    )
    return [(join([feet, post, spine, arms]), "black"), (castors, "rubber"), (join([seat, back]), "fabric blue")]


def visitor_chair() -> Pairs:
    """A plain chair; whoever sits on it looks to -y."""
    legs = cylinders(
        [[x, y, 0] for x in (-0.21, 0.21) for y in (-0.2, 0.22)],
        [[x, y, 0.84 if y > 0 else 0.44] for x in (-0.21, 0.21) for y in (-0.2, 0.22)],
        0.012,
        8,
    )
    seat = blocks((0, 0, 0.44, 0.44, 0.44, 0.04))
    back = blocks((0, 0.22, 0.58, 0.44, 0.04, 0.28))
    return [(legs, "aluminium"), (join([seat, back]), "fabric red")]


def monitor() -> Pairs:
    """A screen that stands on a desk."""
    case = blocks((0, 0.0, 0.14, 0.58, 0.04, 0.36), (0, 0.05, 0.1, 0.06, 0.03, 0.25))
    foot = lathe([[0, 0], [0.12, 0], [0.11, 0.015], [0, 0.015]], 20).moved(0, 0.05, 0)
    return [(join([case, foot]), "black"), (blocks((0, -0.022, 0.16, 0.55, 0.006, 0.32)), "screen")]


def keyboard() -> Pairs:
    """A keyboard that lies on a desk."""
    keys = [
        (-0.2 + 0.0265 * c + 0.005 * (r % 3), 0.05 - 0.022 * r, 0.015, 0.021, 0.018, 0.008)
        for r in range(5)
        for c in range(15)
    ]
    return [(blocks((0, 0, 0, 0.46, 0.15, 0.016)), "grey"), (blocks(*keys), "black")]


def computer() -> Pairs:
    """A computer that stands under a desk."""
    slots = [(0, -0.226, 0.06 + 0.02 * k, 0.14, 0.006, 0.008) for k in range(6)]
    return [
        (blocks((0, 0, 0.02, 0.19, 0.45, 0.42)), "black"),
        (blocks(*slots, (0, -0.226, 0.36, 0.15, 0.006, 0.03)), "grey"),
    ]


def shelf() -> Pairs:
    """A book shelf 1 m wide and 2 m high, its back to +y."""
    sides = blocks((-0.485, 0, 0, 0.03, 0.3, 2.0), (0.485, 0, 0, 0.03, 0.3, 2.0), (0, 0.14, 0, 0.94, 0.02, 2.0))
    boards = blocks(*[(0, -0.01, 0.05 + 0.39 * k, 0.94, 0.28, 0.025) for k in range(6)])
    return [(join([sides, boards]), "wood dark")]


BOOK_COLOURS = ("red", "blue", "ochre", "paper")


def books(count: int, rng: np.random.Generator) -> Pairs:
    """`count` books in the five bays of a `shelf`, in four colours; 12 triangles each."""
    wide = rng.uniform(0.018, 0.05, count)
    high = rng.uniform(0.2, 0.32, count)
    deep = rng.uniform(0.16, 0.24, count)
    bay = np.arange(count) % 5
    left, right = np.empty(count), np.empty(count)
    for k in range(5):
        row = bay == k
        ends = np.cumsum(wide[row] + 0.001)
        squeeze = min(1.0, 0.92 / ends[-1]) if row.any() else 1.0
        right[row] = -0.465 + ends * squeeze
        left[row] = -0.465 + (ends - wide[row]) * squeeze
    bottom = 0.076 + 0.39 * bay
    lo = np.stack([left, np.full(count, -0.13), bottom], axis=1)
    hi = np.stack([right, -0.13 + deep, bottom + high], axis=1)
    colour = rng.integers(0, len(BOOK_COLOURS), count)
    return [
        (boxes(lo[colour == k], hi[colour == k]), name) for k, name in enumerate(BOOK_COLOURS) if (colour == k).any()
    ]


BOOK_CAPACITY = 140  # books that fit well into one shelf
BOOK_VARIANTS = 8


def stocked_books(variant: int) -> Pairs:
    """A full shelf of books, one of BOOK_VARIANTS."""
    return books(BOOK_CAPACITY - 7 * variant, np.random.default_rng([7, variant]))


def meeting_table() -> Pairs:
    """A table 3.6 m long."""
    outline = np.array(
        [[-1.8, -0.45], [-1.5, -0.62], [1.5, -0.62], [1.8, -0.45], [1.8, 0.45], [1.5, 0.62], [-1.5, 0.62], [-1.8, 0.45]]
    )
    top = prisms(outline, [[0, 0, 0.71]], np.eye(3)[None], [0.04])
    foot = lathe([[0, 0], [0.35, 0], [0.34, 0.03], [0.06, 0.06], [0.05, 0.68], [0.2, 0.71], [0, 0.71]], 24)
    return [(top, "wood"), (join([foot.moved(-1.1), foot.moved(1.1)]), "aluminium")]


def pot_plant() -> Pairs:
    """A plant in a pot, 1 m high."""
    rng = np.random.default_rng(11)
    pot = lathe([[0, 0], [0.14, 0], [0.19, 0.34], [0.17, 0.34], [0.165, 0.3], [0, 0.3]], 20)
    count = 60
    yaw, tilt = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.15, 1.1, count)
    length = rng.uniform(0.35, 0.75, count)
    along = np.stack([np.sin(tilt) * np.cos(yaw), np.sin(tilt) * np.sin(yaw), np.cos(tilt)], axis=1)
    outline = np.array([[-0.006, 0], [0, -0.02], [0.006, 0], [0, 0.02]])
    start = np.array([0, 0, 0.29]) + along * 0.02
    stems = prisms(outline * 0.25, start, frames_along(along), length)
    frame = frames_along(along)
    leaves = turned_boxes(
        start + along * length[:, None],
        np.stack([np.full(count, 0.035), np.full(count, 0.004), length * 0.22], axis=1),
        frame,
    )
    return [(pot, "terracotta"), (join([stems, leaves]), "leaf")]


def desk_things() -> Pairs:
    """Papers, a tray, a telephone and pens, to lie on a desk."""
    rng = np.random.default_rng(13)
    angle, count = rng.uniform(-0.3, 0.3, 14), 14
    flat = np.zeros((count, 3, 3))
    flat[:, 0, 0] = flat[:, 1, 1] = np.cos(angle)
    flat[:, 1, 0], flat[:, 0, 1], flat[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    at = np.stack(
        [rng.uniform(-0.03, 0.03, count), rng.uniform(-0.03, 0.03, count), 0.001 + 0.003 * np.arange(count)], axis=1
    )
    sheets = turned_boxes(at, np.tile([0.105, 0.148, 0.0011], (count, 1)), flat)
    tray = blocks(
        *[(0.3, 0, 0.05 * k, 0.26, 0.33, 0.006) for k in range(3)],
        (0.172, 0, 0, 0.006, 0.33, 0.13),
        (0.428, 0, 0, 0.006, 0.33, 0.13),
    )
    phone = blocks(
        (-0.28, 0.02, 0, 0.2, 0.2, 0.04),
        (-0.34, 0.02, 0.04, 0.05, 0.22, 0.03),
        *[(-0.28 + 0.03 * (k % 4), -0.04 + 0.03 * (k // 4), 0.04, 0.02, 0.02, 0.006) for k in range(16)],
    )
    holder = lathe([[0, 0], [0.04, 0], [0.04, 0.1], [0.036, 0.1], [0.034, 0.01], [0, 0.01]], 16).moved(0.3, 0.26)
    pens = cylinders(
        [[0.3 + 0.01 * k, 0.26, 0.02] for k in (-1, 0, 1)], [[0.3 + 0.03 * k, 0.27, 0.16] for k in (-1, 0, 1)], 0.004, 6
    )
    return [(sheets, "paper"), (join([tray, phone, holder]), "black"), (pens, "blue")]


def radiator() -> Pairs:
    """A radiator 1.2 m wide below a window."""
    fins = [(-0.57 + 0.06 * k, 0, 0.12, 0.035, 0.09, 0.5) for k in range(20)]
    tubes = cylinders([[-0.6, 0, 0.16], [-0.6, 0, 0.58]], [[0.6, 0, 0.16], [0.6, 0, 0.58]], 0.02, 10)
    return [(join([blocks(*fins), tubes]), "white")]


def door_leaf() -> Pairs:
    """A leaf 0.96 m wide and 2.1 m high; its hinge is the z axis and it lies along +x."""
    panel = blocks((0.48, 0, 0.005, 0.96, 0.04, 2.09))
    raised = blocks(
        *[
            (x, y, z, 0.32, 0.012, h)
            for x in (0.26, 0.70)
            for y in (-0.024, 0.024)
            for z, h in ((0.15, 0.75), (1.1, 0.85))
        ]
    )
    handles = cylinders(
        [[0.88, -0.07, 1.02], [0.88, 0.07, 1.02], [0.88, -0.07, 1.02], [0.88, 0.0, 1.02]],
        [[0.76, -0.07, 1.02], [0.76, 0.07, 1.02], [0.88, 0.0, 1.02], [0.88, 0.07, 1.02]],
        0.011,
        10,
    )
    return [(join([panel, raised]), "wood"), (handles, "aluminium")]


def ceiling_lamp() -> Pairs:
    """A lamp that hangs from the origin."""
    body = blocks((0, 0, -0.06, 1.2, 0.3, 0.05), (-0.4, 0, -0.01, 0.02, 0.02, 0.01), (0.4, 0, -0.01, 0.02, 0.02, 0.01))
    louvres = blocks(*[(-0.54 + 0.09 * k, 0, -0.09, 0.01, 0.26, 0.03) for k in range(13)])
    return [(body, "white"), (louvres, "glow")]


def desk_lamp() -> Pairs:
    """A lamp that stands on a desk."""
    foot = lathe([[0, 0], [0.09, 0], [0.085, 0.02], [0.02, 0.03], [0, 0.03]], 20)
    arm = cylinders([[0, 0, 0.02], [0, 0.1, 0.25]], [[0, 0.1, 0.26], [0, -0.12, 0.42]], 0.008, 8)
    shade = lathe([[0, 0.40], [0.09, 0.34], [0.03, 0.44], [0, 0.45]], 20)
    return [(join([foot, arm]), "black"), (shade.moved(0, -0.12, 0.0), "yellow")]


def bin_() -> Pairs:
    """A waste-paper bin."""
    return [(lathe([[0, 0.0], [0.12, 0.0], [0.15, 0.32], [0.145, 0.32], [0.115, 0.01], [0, 0.01]], 20), "grey")]


def cabinet() -> Pairs:
    """A cabinet with four drawers."""
    body = blocks((0, 0, 0, 0.8, 0.42, 1.3))
    fronts = blocks(*[(0, -0.215, 0.04 + 0.31 * k, 0.76, 0.015, 0.29) for k in range(4)])
    handles = blocks(*[(0, -0.235, 0.2 + 0.31 * k, 0.16, 0.025, 0.02) for k in range(4)])
    return [(body, "light grey"), (fronts, "grey"), (handles, "aluminium")]


def sofa(colour: str) -> Pairs:
    """A sofa for two."""
    body = blocks(
        (0, 0, 0.12, 1.9, 0.85, 0.2),
        (0, 0.36, 0.3, 1.9, 0.16, 0.45),
        (-0.88, -0.04, 0.3, 0.14, 0.76, 0.28),
        (0.88, -0.04, 0.3, 0.14, 0.76, 0.28),
    )
    cushions = blocks((-0.41, -0.06, 0.32, 0.78, 0.66, 0.13), (0.41, -0.06, 0.32, 0.78, 0.66, 0.13))
    feet = blocks(*[(x, y, 0, 0.06, 0.06, 0.12) for x in (-0.85, 0.85) for y in (-0.35, 0.35)])
    return [(join([body, cushions]), colour), (feet, "wood dark")]


def bed() -> Pairs:
    """A double bed, its head to +y."""
    frame = blocks((0, 0, 0.1, 1.5, 2.05, 0.2), (0, 1.0, 0.3, 1.5, 0.06, 0.6))
    mattress = blocks(
        (0, -0.02, 0.3, 1.42, 1.95, 0.2), (-0.35, 0.75, 0.5, 0.55, 0.35, 0.1), (0.35, 0.75, 0.5, 0.55, 0.35, 0.1)
    )
    blanket = blocks((0, -0.4, 0.5, 1.46, 1.2, 0.04))
    return [(frame, "wood"), (mattress, "white"), (blanket, "fabric blue")]


def wardrobe() -> Pairs:
    """A wardrobe with two doors."""
    doors = blocks((-0.3, -0.305, 0.06, 0.57, 0.02, 2.0), (0.3, -0.305, 0.06, 0.57, 0.02, 2.0))
    handles = blocks((-0.06, -0.325, 1.0, 0.02, 0.02, 0.2), (0.06, -0.325, 1.0, 0.02, 0.02, 0.2))
    return [(join([blocks((0, 0, 0, 1.24, 0.6, 2.1)), doors]), "wood"), (handles, "brass")]


def kitchen() -> Pairs:
    """A kitchenette 2.4 m wide, its back to +y."""
    base = blocks((0, 0.02, 0.1, 2.4, 0.56, 0.76), (0, 0.15, 1.4, 2.4, 0.35, 0.7))
    fronts = blocks(
        *[(-0.9 + 0.6 * k, -0.27, 0.14, 0.56, 0.02, 0.68) for k in range(4)],
        *[(-0.9 + 0.6 * k, -0.035, 1.43, 0.56, 0.02, 0.64) for k in range(4)],
    )
    knobs = blocks(
        *[(-0.68 + 0.6 * k, -0.29, 0.7, 0.02, 0.02, 0.1) for k in range(4)],
        *[(-0.68 + 0.6 * k, -0.055, 1.47, 0.02, 0.02, 0.1) for k in range(4)],
    )
    plates = join([ring(0.09, 0.008, 24, 6).moved(x, y, 0.905) for x in (-0.75, -0.45) for y in (-0.1, 0.14)])
    tap = cylinders([[0.6, 0.22, 0.9], [0.6, 0.23, 1.12]], [[0.6, 0.22, 1.14], [0.6, 0.0, 1.12]], 0.014, 10)
    return [
        (base, "cream"),
        (fronts, "teal"),
        (blocks((0, 0, 0.86, 2.44, 0.62, 0.04)), "slate"),
        (join([knobs, tap]), "aluminium"),
        (plates, "black"),
    ]


def toilet() -> Pairs:
    """A toilet, its back to +y."""
    bowl = lathe([[0, 0], [0.13, 0], [0.11, 0.12], [0.19, 0.4], [0.15, 0.4], [0.1, 0.24], [0, 0.22]], 28)
    seat = ring(0.165, 0.022, 28, 8).moved(0, 0, 0.42)
    return [(join([bowl, blocks((0, 0.26, 0.36, 0.38, 0.18, 0.38))]), "ceramic"), (seat, "white")]


def basin() -> Pairs:
    """A wash basin on a column, its back to +y."""
    bowl = lathe([[0, 0.72], [0.1, 0.73], [0.24, 0.86], [0.22, 0.86], [0.1, 0.76], [0, 0.75]], 28)
    tap = cylinders([[0, 0.2, 0.8], [0, 0.21, 0.98]], [[0, 0.2, 1.0], [0, 0.06, 0.96]], 0.013, 10)
    return [(join([bowl, lathe([[0, 0], [0.07, 0], [0.05, 0.74], [0, 0.74]], 20)]), "ceramic"), (tap, "aluminium")]


def cup() -> Pairs:
    """A cup."""
    body = lathe([[0, 0], [0.035, 0], [0.042, 0.09], [0.038, 0.09], [0.032, 0.008], [0, 0.008]], 16)
    handle = ring(0.025, 0.005, 14, 6).turned([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).moved(0.06, 0, 0.045)
    return [(join([body, handle]), "ceramic")]


def whiteboard() -> Pairs:
    """A board 2.4 m wide that hangs on a wall behind the origin."""
    board = blocks((0, -0.01, 0.9, 2.4, 0.02, 1.2))
    frame = blocks(
        (0, -0.02, 0.86, 2.48, 0.04, 0.04),
        (0, -0.02, 2.1, 2.48, 0.04, 0.04),
        (-1.22, -0.02, 0.9, 0.04, 0.04, 1.2),
        (1.22, -0.02, 0.9, 0.04, 0.04, 1.2),
        (0, -0.05, 0.84, 1.0, 0.08, 0.02),
    )
    return [(board, "white"), (frame, "aluminium")]


def cushion() -> Pairs:
    """A cushion."""
    return [(blob((0.22, 0.22, 0.09), 0.04, 2, np.random.default_rng(5)).moved(0, 0, 0.08), "fabric red")]


FURNISHINGS: dict[str, Recipe] = {
    "basin": basin,
    "bed": bed,
    "bin": bin_,
    **{f"books {k}": partial(stocked_books, k) for k in range(BOOK_VARIANTS)},
    "cabinet": cabinet,
    "ceiling lamp": ceiling_lamp,
    "chair": chair,
    "computer": computer,
    "cup": cup,
    "cushion": cushion,
    "desk": desk,
    "desk lamp": desk_lamp,
    "desk things": desk_things,
    "door leaf": door_leaf,
    "keyboard": keyboard,
    "kitchen": kitchen,
    "meeting table": meeting_table,
    "monitor": monitor,
    "pot plant": pot_plant,
    "radiator": radiator,
    "shelf": shelf,
    "sofa blue": partial(sofa, "fabric blue"),
    "sofa red": partial(sofa, "fabric red"),
    "toilet": toilet,
    "visitor chair": visitor_chair,
    "wardrobe": wardrobe,
    "whiteboard": whiteboard,
}
