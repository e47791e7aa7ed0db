"""Hypothesis strategies for what a store holds."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from storage.cells import octree
from storage.meshes.pack import MeshArrays


@st.composite
def id_sets(draw: st.DrawFn, largest: int = 2**32 - 1, longest: int = 60) -> np.ndarray:
    """A strictly increasing array of ids, uint32."""
    ids = draw(st.sets(st.integers(0, largest), max_size=longest))
    return np.array(sorted(ids), np.uint32)


@st.composite
def leaf_sets(draw: st.DrawFn, splits: int = 8, holes: bool = True) -> np.ndarray:
    """Keys of octree leaves of mixed depths, in any order, perhaps with holes; never empty."""
    keys = [octree.ROOT]
    for _ in range(draw(st.integers(0, splits))):
        at = draw(st.integers(0, len(keys) - 1))
        if octree.depth(keys[at]) < octree.MAX_DEPTH:
            keys += [int(key) for key in octree.children(keys.pop(at))]
    if holes and len(keys) > 1:
        kept = draw(st.lists(st.booleans(), min_size=len(keys), max_size=len(keys)))
        keys = [key for key, keep in zip(keys, kept, strict=True) if keep] or keys[:1]
    return np.array(draw(st.permutations(keys)), np.uint64)


@st.composite
def meshes(draw: st.DrawFn, largest: int = 1 << 23) -> MeshArrays:
    """Any mesh at all: few distinct positions, so that vertices share them; degenerate and double triangles; unused
    vertices.
    """
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    places = draw(st.integers(1, 12))
    count = draw(st.integers(0, 30))
    faces = draw(st.integers(0, 40)) if count else 0
    span = draw(st.sampled_from([1, 5, 1000, largest]))
    pool = random.integers(-span, span, (places, 3), endpoint=True)
    normals = random.normal(size=(max(1, places // 2), 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    colours = random.integers(0, 256, (2, 4))
    return MeshArrays(
        pool[random.integers(0, places, count)].astype(np.int32).reshape(-1, 3),
        random.integers(0, max(1, count), (faces, 3)).astype(np.uint32),
        normals[random.integers(0, len(normals), count)].astype(np.float32).reshape(-1, 3),
        colours[random.integers(0, 2, count)].astype(np.uint8).reshape(-1, 4),
        random.integers(0, 2**32, (faces, 2), dtype=np.uint32) if draw(st.booleans()) else None,
        2.0 ** draw(st.integers(-30, 10)),
    )
