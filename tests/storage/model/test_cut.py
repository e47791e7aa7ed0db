import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.base.errors import ParameterError
from storage.model.cut import UNBOUNDED, choose_cut, coarsest_triangles, cut_within, pixel_angle, possible_drawables
from storage.model.tables import DRAWABLE, NODE
from storage.model.tree import children, parents, roots


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


def _forest(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in preorder with boxes around those below them, and drawables whose errors know nothing of the tree."""
    nodes, drawables = np.zeros(count, NODE), []
    for i in range(count - 1, -1, -1):
        end = i + 1
        while end < count and random.random() < 0.6:
            end = int(nodes["end"][end])
        below = nodes[i + 1 : end]
        nodes["end"][i] = end
        lo = random.uniform(-10, 10, 3)
        nodes["lo"][i] = np.min([lo, *below["lo"]], axis=0)
        nodes["hi"][i] = np.max([lo + random.uniform(0, 3, 3), *below["hi"]], axis=0)
    for node in nodes:
        node["first_drawable"], node["levels"] = len(drawables), random.integers(1, 6)
        for error in np.sort(random.uniform(0, 0.02, node["levels"])):
            row = np.zeros((), DRAWABLE)
            row["error"] = error
            drawables.append(row)
    return nodes, np.array(drawables, DRAWABLE)


def _expected(nodes, drawables, node, fits):
    """The cut below a node by the definition, one node at a time."""
    first, levels = int(nodes["first_drawable"][node]), int(nodes["levels"][node])
    good = [first + level for level in range(levels) if fits(node, float(drawables["error"][first + level]))]
    if good:
        return [good[-1]]
    if nodes["end"][node] == node + 1:
        return [first]
    found, child = [], node + 1
    while child < nodes["end"][node]:
        found += _expected(nodes, drawables, child, fits)
        child = int(nodes["end"][child])
    return found


@given(st.integers(0, 30), st.integers(0, 2**32 - 1), st.sampled_from([0.5, 1, 3]))
def test_the_cut_is_the_coarsest_that_is_fine_enough(count: int, seed: int, pixels: float) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _forest(random, count)
    lo = random.uniform(-12, 12, 3)
    hi = lo + random.uniform(0, 2, 3)

    def fits(node, error):
        gap = np.maximum(np.maximum(nodes["lo"][node] - hi, lo - nodes["hi"][node]), 0)
        return error <= pixels * 1e-3 * (np.sqrt((gap * gap).sum()) - error)

    expected = [d for root in roots(nodes).tolist() for d in _expected(nodes, drawables, root, fits)]
    assert choose_cut(nodes, drawables, lo, hi, 1e-3, pixels).tolist() == sorted(expected)
    wide = [d for root in roots(nodes).tolist() for d in _expected(nodes, drawables, root, lambda _, e: e <= 0.004)]
    assert cut_within(nodes, drawables, 0.004).tolist() == sorted(wide)


def _front_by_front(nodes, drawables, lo, hi, allowed):
    """The cut as array operations, all nodes of a depth at once."""
    edges = hi - lo
    anywhere = max(0.0, allowed - UNBOUNDED) * float(
        np.sqrt((edges[0] * edges[0] + edges[1] * edges[1]) + edges[2] ** 2)
    )
    front, chosen = roots(nodes), [np.zeros(0, np.int64)]
    while len(front):
        rows = nodes[front]
        gap = np.maximum(np.maximum(rows["lo"].astype(float) - hi, lo - rows["hi"].astype(float)), 0)
        reach = np.sqrt((gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1]) + gap[:, 2] * gap[:, 2])
        first = rows["first_drawable"].astype(np.int64)
        best = np.where(rows["end"] == front + 1, first, -1)
        for level in range(int(rows["levels"].max())):
            having = np.flatnonzero(rows["levels"] > level)
            error = drawables["error"][first[having] + level].astype(float)
            good = (error <= allowed * (reach[having] - error)) | (error <= anywhere)
            best[having[good]] = first[having[good]] + level
        chosen.append(best[best >= 0])
        front = children(nodes, front[best < 0])
    return np.sort(np.concatenate(chosen))


@settings(max_examples=30)
@given(st.integers(0, 900), st.integers(0, 2**32 - 1), st.sampled_from([0.01, 0.5, 3, 130, 400]), st.booleans())
def test_the_kernel_chooses_what_array_operations_choose(count: int, seed: int, pixels: float, edge: bool) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _forest(random, count)
    lo = random.uniform(-12, 12, 3)
    hi = lo + random.uniform(0, 2, 3)
    if edge and count:  # the last node's first level is as far off as is allowed, to the last bit or nearly so
        lo = hi = nodes["hi"][-1].astype(float) + np.array([3.0, 0, 0])
        drawables["error"][-1] = 3 * pixels * 1e-3 / (1 + pixels * 1e-3)
    expected = _front_by_front(nodes, drawables, lo, hi, pixels * 1e-3)
    assert np.array_equal(choose_cut(nodes, drawables, lo, hi, 1e-3, pixels), expected)


def test_levels_that_there_are_not_are_refused() -> None:
    nodes, drawables = _forest(np.random.default_rng(1), 5)
    with pytest.raises(IndexError, match="levels that there are not"):
        choose_cut(nodes, drawables[:-1], np.zeros(3), np.ones(3), 1e-9, 1.0)


@given(st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_what_is_not_wanted_is_left_out_with_all_below_it(count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _forest(random, count)
    wanted = random.random(count) < 0.7
    above = parents(nodes)
    kept = wanted.copy()
    for node in range(count):
        kept[node] &= above[node] < 0 or kept[above[node]]
    everything = choose_cut(nodes, drawables, np.zeros(3), np.zeros(3), 1e-3, 1.0)
    some = choose_cut(nodes, drawables, np.zeros(3), np.zeros(3), 1e-3, 1.0, lambda ids: wanted[ids])
    node_of = np.repeat(np.arange(count), nodes["levels"])
    assert some.tolist() == everything[kept[node_of[everything]]].tolist()


def _ordered_forest(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A forest whose errors grow towards the roots, as a store's do."""
    nodes, drawables = _forest(random, count)
    above = parents(nodes)
    drawables["error"] += np.float32(0.001)
    drawables["triangles"] = random.integers(1, 50, len(drawables))
    for node in range(count - 1, -1, -1):
        own = slice(int(nodes["first_drawable"][node]), int(nodes["first_drawable"][node] + nodes["levels"][node]))
        below = np.flatnonzero(above == node)
        ends = nodes["first_drawable"][below] + nodes["levels"][below] - 1
        drawables["error"][own] += drawables["error"][ends].max(initial=0)
    return nodes, drawables


@given(st.integers(1, 30), st.integers(0, 2**32 - 1), st.sampled_from([0.5, 3, 130, 400]))
def test_possible_drawables_hold_the_cuts_of_all_boxes_inside(count: int, seed: int, pixels: float) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _ordered_forest(random, count)
    lo = random.uniform(-12, 12, 3)
    hi = lo + random.uniform(0.1, 4, 3)
    edges = (hi - lo) * random.choice([1, 0.5, 0.25])
    possible = possible_drawables(nodes, drawables, lo, hi, edges, 1e-3, pixels)
    assert (np.diff(possible) > 0).all()
    for _ in range(10):
        low = lo + random.random(3) * (hi - lo - edges)
        assert np.isin(choose_cut(nodes, drawables, low, low + edges, 1e-3, pixels), possible).all()
    if (edges == hi - lo).all():
        assert np.array_equal(possible, choose_cut(nodes, drawables, lo, hi, 1e-3, pixels))


@given(st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_what_touches_the_box_gets_coarser_beyond_the_bound_only(count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    nodes, drawables = _ordered_forest(random, count)
    lo, hi = nodes["lo"].min(axis=0).astype(float), nodes["hi"].max(axis=0).astype(float)  # every node touches it
    leaf = nodes["end"] == np.arange(count) + 1
    finest = nodes["first_drawable"][leaf]
    diagonal = float(np.linalg.norm(hi - lo))
    assert choose_cut(nodes, drawables, lo, hi, 1e-3, 1000 * UNBOUNDED).tolist() == finest.tolist()
    wide = choose_cut(nodes, drawables, lo, hi, 1e-3, 1000 * (UNBOUNDED + 0.004 / diagonal))
    assert drawables["error"][wide[~np.isin(wide, finest)]].max(initial=0) <= 0.004 * (1 + 1e-6)
    assert wide.tolist() == cut_within(nodes, drawables, 0.004).tolist()
    coarsest = choose_cut(nodes, drawables, lo, hi, 1e-3, 1e9)
    assert len(coarsest) == len(roots(nodes))
    assert drawables["triangles"][coarsest].sum() == coarsest_triangles(nodes, drawables)
