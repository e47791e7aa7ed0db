import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.detail import box_distance, choose_levels, pixel_angle
from storage.errors import ParameterError
from storage.tables import DRAWABLE, NODE


@given(st.integers(1, 4000), st.floats(5, 160), st.floats(0.3, 4), st.integers(0, 2**32 - 1))
def test_no_displacement_within_the_pixel_angle_is_seen_as_a_pixel(
    height: int, field: float, aspect: float, seed: int
) -> None:
    """Moves points of the screen by that much in all directions and measures how far their images move."""
    random = np.random.default_rng(seed)
    focal = height / 2 / np.tan(np.radians(field) / 2)
    half = np.array([aspect, 1]) * height / 2
    screen = np.concatenate([[half, -half], random.uniform(-1, 1, (50, 2)) * half])
    points = np.concatenate([screen, np.full((len(screen), 1), focal)], axis=1)
    distance = np.linalg.norm(points, axis=1)
    step = 1e-4  # small against the distance, so that only the first order counts
    direction = random.normal(size=points.shape)
    direction[:2] = [[*half, 0], [*half, 0]]
    direction -= points * (np.sum(direction * points, axis=1) / distance**2)[:, None]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    moved = points / distance[:, None] + direction * pixel_angle(height, field, aspect) * step
    image = moved[:, :2] / moved[:, 2:] * focal
    change = np.linalg.norm(image - screen, axis=1) / step
    assert change.max() < 1.02
    assert change[:2].min() > 0.98


@pytest.mark.parametrize("given", [(0, 60, 1), (1080, 0, 1), (1080, 180, 1), (1080, 60, 0), (float("nan"), 60, 1)])
def test_senseless_screens_are_refused(given: tuple[float, float, float]) -> None:
    with pytest.raises(ParameterError, match="must be"):
        pixel_angle(*given)


def _tables(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    nodes, drawables = np.zeros(count, NODE), []
    for node in nodes:
        node["first_drawable"], node["levels"] = len(drawables), random.integers(1, 6)
        node["lo"] = random.uniform(-10, 10, 3)
        node["hi"] = node["lo"] + random.uniform(0, 3, 3)
        for error in np.sort(random.uniform(0, 0.02, node["levels"])):
            row = np.zeros((), DRAWABLE)
            row["error"] = error
            drawables.append(row)
    return nodes, np.array(drawables, DRAWABLE)


@given(st.integers(0, 12), st.integers(0, 2**32 - 1), st.sampled_from([0.5, 1, 3]))
def test_the_coarsest_level_that_is_fine_enough_is_taken(count: int, seed: int, pixels: float) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _tables(random, count)
    lo = random.uniform(-12, 12, 3)
    hi = lo + random.uniform(0, 2, 3)
    expected = []
    for node in nodes:
        gap = np.maximum(np.maximum(node["lo"] - hi, lo - node["hi"]), 0)
        distance = np.sqrt((gap * gap).sum())
        best = 0
        for level in range(node["levels"]):
            error = float(drawables[node["first_drawable"] + level]["error"])
            if error <= pixels * 1e-3 * (distance - error):
                best = level
        expected.append(node["first_drawable"] + best)
    assert choose_levels(nodes, drawables, lo, hi, 1e-3, pixels).tolist() == expected
    some = random.permutation(count)[: count // 2]
    assert choose_levels(nodes[some], drawables, lo, hi, 1e-3, pixels).tolist() == sorted(expected[i] for i in some)


def test_distance_of_boxes() -> None:
    lo, hi = [[0, 0, 0], [4, 5, 0], [0.5, 0.5, -3]], [[2, 2, 2], [5, 6, 1], [0.6, 0.6, -2]]
    assert box_distance([0, 0, 0], [1, 1, 1], lo, hi).tolist() == [0, 5, 2]
