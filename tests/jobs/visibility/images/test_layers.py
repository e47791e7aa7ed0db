"""Pairs of depths: whatever a pixel says is hidden, one of the pairs it was given says so."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jobs.visibility.images.layers import add_layer, clear_layers, pixel_hides

pairs = st.lists(
    st.tuples(st.floats(1, 1e5), st.one_of(st.just(np.inf), st.floats(1, 1e6))).filter(lambda pair: pair[0] < pair[1]),
    max_size=20,
)


def layers_of(given_pairs: list[tuple[float, float]], count: int) -> np.ndarray:
    layers = np.empty((6, 2, 2, count, 2), np.float32)
    clear_layers(layers)
    for depth, limit in given_pairs:
        add_layer(layers, 3, 1, 0, depth, limit)
    return layers


@given(pairs, st.integers(1, 6), st.lists(st.tuples(st.floats(1, 2e6), st.floats(1, 2e6)), max_size=30))
def test_nothing_is_hidden_that_no_pair_hides(
    given_pairs: list[tuple[float, float]], count: int, asked: list[tuple[float, float]]
) -> None:
    layers = layers_of(given_pairs, count)
    for near, far in asked:
        low, high = min(near, far), max(near, far)
        if pixel_hides(layers, 3, 1, 0, low, high):
            assert any(depth < low and limit >= high for depth, limit in given_pairs)


@given(pairs)
def test_with_places_enough_nothing_is_lost(given_pairs: list[tuple[float, float]]) -> None:
    layers = layers_of(given_pairs, len(given_pairs) + 1)
    for depth, limit in given_pairs:
        far = 1e30 if np.isinf(limit) else limit * (1 - 1e-6)
        if depth * (1 + 2e-6) < far:
            assert pixel_hides(layers, 3, 1, 0, depth * (1 + 2e-6), far)
    kept = layers[3, 1, 0]
    used = np.isfinite(kept[:, 0])
    assert (np.diff(kept[used, 0]) > 0).all()
    assert (np.diff(kept[used, 1]) > 0).all()
    assert (layers[3, 0, 0, :, 0] == np.inf).all()


def test_the_narrowest_pair_makes_room() -> None:
    layers = layers_of([(2.0, 3.0), (4.0, 400.0), (10.0, np.inf)], 2)
    assert not pixel_hides(layers, 3, 1, 0, 2.5, 2.9)
    assert pixel_hides(layers, 3, 1, 0, 5.0, 300.0)
    assert pixel_hides(layers, 3, 1, 0, 11.0, np.inf)
