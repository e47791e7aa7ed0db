"""Groups of cells come back whole, and nothing that bytes say leads out of the cuts."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError
from storage.cells.codecs.context_mixing import NEAREST, nearest_before
from storage.cells.codecs.contexts import Coder, prior
from storage.cells.decisions import decisions
from storage.cells.group import Group, Tree
from storage.model.tables import DRAWABLE, NODE
from storage.model.tree import parents


def _group(seed: int, count: int, cells: int) -> tuple[Group, list[np.ndarray]]:
    """A forest of nodes, one or two drawables each; cells with cuts of their own, and parts of these that are seen."""
    random = np.random.default_rng(seed)
    nodes = np.zeros(count, NODE)
    for i in range(count - 1, -1, -1):
        end = i + 1
        while end < count and random.random() < 0.7:
            end = int(nodes["end"][end])
        nodes["end"][i] = end
    nodes["lo"] = random.uniform(-9, 9, (count, 3))
    nodes["hi"] = nodes["lo"] + random.uniform(0, 3, (count, 3)).astype(np.float32)
    nodes["levels"] = random.integers(1, 3, count)
    nodes["first_drawable"] = np.cumsum(nodes["levels"]) - nodes["levels"]
    drawables = np.zeros(int(nodes["levels"].sum()), DRAWABLE)
    drawables["node"] = np.repeat(np.arange(count), nodes["levels"])
    seen_always = random.random(count) < 0.4
    cuts, sets = [], []
    for _ in range(cells):
        cut, seen, node = [], [], 0
        while node < count:
            if nodes["end"][node] == node + 1 or random.random() < 0.2:
                cut.append(int(nodes["first_drawable"][node] + random.integers(nodes["levels"][node])))
                seen.append(seen_always[node] != (random.random() < 0.1))
                node = int(nodes["end"][node])
            else:
                node += 1
        cuts.append(np.array(cut, np.int64))
        sets.append(cuts[-1][np.array(seen, bool)])
    centres = random.integers(0, 1 << 21, (cells, 3))
    lo = random.uniform(-9, 9, (cells, 1, 3))
    return Group(Tree(nodes, drawables), centres, np.concatenate([lo, lo + 1], axis=1), tuple(cuts)), sets


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 12))
def test_sets_come_back(seed: int, count: int, cells: int) -> None:
    group, sets = _group(seed, count, cells)
    data = Coder(prior()).encode(sets, group)
    back = Coder(prior()).decode(data, group)
    assert [ids.tolist() for ids in back] == [ids.tolist() for ids in sets]


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.binary(max_size=60))
def test_whatever_bytes_say_is_a_part_of_the_cuts(seed: int, data: bytes) -> None:
    group, _ = _group(seed, 40, 5)
    for ids, cut in zip(Coder(prior()).decode(data, group), group.cuts, strict=True):
        assert np.isin(ids, cut).all()


def test_the_bytes_are_the_same_on_every_machine() -> None:
    """Not by round trips alone: a store is read on other machines than the one that wrote it."""
    group, sets = _group(7, 300, 20)
    assert hashlib.sha256(Coder(prior()).encode(sets, group)).hexdigest()[:16] == "462835cee6ba947e"


def test_decisions_are_counted_as_they_are_coded() -> None:
    group, sets = _group(3, 200, 9)
    seen = [np.isin(cut, ids) for cut, ids in zip(group.cuts, sets, strict=True)]
    nodes = np.split(group.part.cut, group.cut_ends[:-1])
    counted = sum(decisions(group.part.end, cut, own) for cut, own in zip(nodes, seen, strict=True))
    data = np.zeros(4 * 200 * 9 + 8, np.uint8)
    _, made, _ = Coder(prior()).run(group, np.concatenate(seen), data, decoding=False)
    assert made == counted


def test_what_is_not_in_the_cut_is_refused() -> None:
    group, sets = _group(3, 30, 2)
    outside = np.setdiff1d(np.arange(len(group.tree.node_of)), group.cuts[0])[:1]
    with pytest.raises(ValueError, match="not in its cut"):
        Coder(prior()).encode([np.sort(np.concatenate([sets[0], outside])), sets[1]], group)


def test_nodes_that_end_before_themselves_are_refused() -> None:
    for end in (0, 3):
        nodes = np.zeros(2, NODE)
        nodes["end"] = [2, end]
        with pytest.raises(CorruptStoreError, match="ends before itself"):
            Tree(nodes, np.zeros(2, DRAWABLE))


@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_the_nearest_cells_are_those_before(seed: int, cells: int) -> None:
    group, _ = _group(seed, 5, cells)
    centres = group.centres % 4  # many are equally near
    nearest = np.empty((cells, NEAREST), np.int64)
    nearest_before(centres, nearest)
    for cell in range(cells):
        squares = ((centres[:cell] - centres[cell]) ** 2).sum(axis=1)
        expected = np.lexsort((-np.arange(cell), squares))[:NEAREST].tolist()
        assert nearest[cell].tolist() == expected + [-1] * (NEAREST - len(expected))


def test_a_tree_knows_what_is_above_each_node() -> None:
    group, _ = _group(11, 60, 1)
    nodes = np.zeros(60, NODE)
    nodes["end"] = group.tree.end
    assert group.tree.parent.tolist() == parents(nodes).tolist()
