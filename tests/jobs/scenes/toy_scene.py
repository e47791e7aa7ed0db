"""A toy scene for the tests: a field of boxes. The smallest module that has all a kind of scene needs."""

from __future__ import annotations

import numpy as np

from jobs.scenes.things.draft import EYE_HEIGHT, SceneDraft, SceneKind, Walk
from jobs.scenes.things.solids import boxes


def walk(_triangles: int, _seed: int) -> Walk:
    points = np.array([[-9.0, -9.0, EYE_HEIGHT], [-9.0, 9.0, EYE_HEIGHT]])
    return Walk(points, points)


def build(draft: SceneDraft, triangles: int, _seed: int) -> None:
    for number in range(triangles // 12):
        x, y = divmod(number, 100)
        draft.put(f"box {number}", "box", (float(x), float(y), 0.0))


SCENE = SceneKind(build, walk, {"box": lambda: [(boxes([[0.0, 0.0, 0.0]], [[0.5, 0.5, 0.5]]), "brick")]})
