"""The arena: what was uploaded is what the buffers hold."""

from __future__ import annotations

import moderngl
import numpy as np

from player.renderer.arena import VERTEX, Arena


def _pack(rng: np.random.Generator, vertices: int, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    made = np.zeros(vertices, VERTEX)
    made["position"] = rng.integers(-100, 100, (vertices, 3))
    return made, rng.integers(0, vertices, (triangles, 3)).astype(np.uint32)


def _held(arena: Arena, number: int, triangles: np.ndarray) -> np.ndarray:
    slab = arena.slabs[arena.slab_of[number]]
    indices = np.frombuffer(slab.index_buffer.read(), np.uint32)
    vertices = np.frombuffer(slab.vertex_buffer.read(), VERTEX)
    first = arena.first_index[number]
    return vertices["position"][indices[first : first + triangles.size]].reshape(-1, 3, 3)


def test_packs_survive_growth_removal_and_new_slabs(context: moderngl.Context) -> None:
    rng = np.random.default_rng(1)
    arena = Arena(context, 40, first_vertices=16, largest_vertices=64)
    packs = {number: _pack(rng, int(rng.integers(3, 60)), int(rng.integers(1, 90))) for number in range(40)}
    for number, (vertices, triangles) in packs.items():
        arena.add(number, vertices, triangles)
    assert len(arena.slabs) > 1
    for number in range(0, 40, 3):
        arena.remove(number)
        assert arena.slab_of[number] == -1
    slabs = len(arena.slabs)
    for number in range(0, 40, 3):
        arena.add(number, *packs[number])
    assert len(arena.slabs) <= slabs + 1
    for number, (vertices, triangles) in packs.items():
        assert np.array_equal(_held(arena, number, triangles), vertices["position"][triangles])
    arena.release()


def test_a_pack_larger_than_a_slab_gets_its_own(context: moderngl.Context) -> None:
    arena = Arena(context, 1, first_vertices=16, largest_vertices=64)
    vertices, triangles = _pack(np.random.default_rng(2), 500, 4000)
    arena.add(0, vertices, triangles)
    assert np.array_equal(_held(arena, 0, triangles), vertices["position"][triangles])
    arena.release()
