"""Alpha modes: what becomes of vertices, and which triangles are opaque, seen through, or not there."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.importing.reading.see_through import AlphaMode, see_through
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.reading.texture_alpha import AlphaOver
from jobs.importing.repair import repair

SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


def over(*triples):
    least, mean, greatest = np.array(triples, np.float64).T
    return AlphaOver(least.astype(np.uint8), mean, greatest.astype(np.uint8))


def faces(mode, alpha, texture=None, cutoff=0.5, triangles=SQUARE):
    found = see_through(triangles, np.array(alpha, np.float64), mode, cutoff, texture)
    assert np.array_equal(found.vertices[found.triangles], triangles)
    return found.alpha[found.triangles].tolist()


@pytest.mark.parametrize(
    ("mode", "alpha", "texture", "expected"),
    [
        (AlphaMode.OPAQUE, [0, 0.5, 1, 0.2], over((0, 9, 20), (255, 255, 255)), [[255] * 3, [255] * 3]),
        (AlphaMode.BLEND, [1, 1, 1, 1], None, [[255] * 3, [255] * 3]),
        (AlphaMode.BLEND, [1, 1, 1, 0.5], None, [[255] * 3, [255, 255, 128]]),
        (AlphaMode.BLEND, [0, 0, 0, 0.5], None, [[0] * 3, [0, 0, 128]]),
        (AlphaMode.BLEND, [0.001] * 4, None, [[1] * 3, [1] * 3]),
        (AlphaMode.BLEND, [0.999] * 4, None, [[255] * 3, [255] * 3]),
        (AlphaMode.BLEND, [1] * 4, over((255, 255, 255), (254, 254.9, 255)), [[255] * 3, [254] * 3]),
        (AlphaMode.BLEND, [1] * 4, over((255, 255, 255), (0, 100, 255)), [[255] * 3, [100] * 3]),
        (AlphaMode.BLEND, [0.5] * 4, over((255, 255, 255), (0, 100, 255)), [[128] * 3, [50] * 3]),
        (AlphaMode.BLEND, [1] * 4, over((0, 0, 0), (0, 0.1, 1)), [[0] * 3, [1] * 3]),
        (AlphaMode.MASK, [1] * 4, None, [[255] * 3, [255] * 3]),
        (AlphaMode.MASK, [0.5] * 4, None, [[255] * 3, [255] * 3]),
        (AlphaMode.MASK, [0.4] * 4, None, [[0] * 3, [0] * 3]),
        (AlphaMode.MASK, [1, 1, 0.7, 0], None, [[255] * 3, [144] * 3]),
        (AlphaMode.MASK, [1] * 4, over((128, 200, 255), (0, 90, 127)), [[255] * 3, [0] * 3]),
        (AlphaMode.MASK, [1] * 4, over((127, 254.9, 255), (200, 210, 220)), [[254] * 3, [255] * 3]),
        (AlphaMode.MASK, [np.nan] * 4, None, [[255] * 3, [255] * 3]),
    ],
)
def test_alpha_of_faces(mode, alpha, texture, expected):
    assert faces(mode, alpha, texture) == expected


def test_indices_out_of_range_stay_so():
    triangles = np.array([[0, 1, 2], [0, 1, 9], [-1, 1, 2], [0, 2, 3]])
    texture = over((255, 255, 255), (255, 255, 255), (255, 255, 255), (0, 80, 255))
    found = see_through(triangles, np.ones(4), AlphaMode.BLEND, 0.5, texture)
    assert found.triangles[1:3].max() < 0
    assert np.array_equal(found.vertices[found.triangles[[0, 3]]], triangles[[0, 3]])
    assert found.alpha[found.triangles[[0, 3]]].tolist() == [[255] * 3, [80] * 3]


def test_what_cannot_be_seen_is_left_out_and_counted():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
    colours = np.full((4, 4), 200, np.uint8)
    colours[:3, 3] = 0
    mesh, counts = repair(SourceMesh("a", points, SQUARE, colours=colours))
    assert mesh is not None
    assert mesh.source_faces.tolist() == [1]
    assert counts == {"invisible faces": 1}
    assert sorted(mesh.colours[:, 3].tolist()) == [0, 0, 200]
