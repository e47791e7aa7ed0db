"""Walking the hierarchy, against definitions worked out node by node."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from storage.model.tables import NODE
from storage.model.tree import children, heights, leaves, overlapping, parents, roots


def forest(seed: int, count: int) -> tuple[np.ndarray, list[int]]:
    """Nodes in preorder, and the node above each, -1 above roots."""
    random = np.random.default_rng(seed)
    above: list[int] = []
    for node in range(count):
        line = [node - 1] if node else []
        while line and line[-1] >= 0:
            line.append(above[line[-1]])
        above.append(int(random.choice(line)) if line else -1)
    nodes = np.zeros(count, NODE)
    nodes["end"] = np.arange(count) + 1
    for node in range(count - 1, -1, -1):
        if above[node] >= 0:
            nodes["end"][above[node]] = max(nodes["end"][above[node]], nodes["end"][node])
    return nodes, above


@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_parents_children_roots_and_leaves(seed: int, count: int) -> None:
    nodes, above = forest(seed, count)
    assert parents(nodes).tolist() == above
    assert roots(nodes).tolist() == [node for node in range(count) if above[node] < 0]
    assert leaves(nodes).tolist() == [node not in above for node in range(count)]
    some = np.flatnonzero(np.random.default_rng(seed).random(count) < 0.3)
    assert children(nodes, some).tolist() == [node for node in range(count) if above[node] in some]


@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_heights(seed: int, count: int) -> None:
    nodes, above = forest(seed, count)

    def height(node: int) -> int:
        return max((1 + height(other) for other in range(count) if above[other] == node), default=0)

    assert heights(nodes).tolist() == [height(node) for node in range(count)]


@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_overlapping(seed: int, count: int) -> None:
    nodes, above = forest(seed, count)

    def line(node: int) -> list[int]:
        return [node, *line(above[node])] if node >= 0 else []

    random = np.random.default_rng(seed)
    others: list[int] = []
    for node in random.permutation(count).tolist()[: count // 2]:
        if not any(node in line(other) or other in line(node) for other in others):
            others.append(node)
    some = np.arange(count)
    expected = [any(other in line(node) or node in line(other) for other in others) for node in range(count)]
    assert overlapping(nodes, some, np.sort(np.array(others, np.int64))).tolist() == expected
