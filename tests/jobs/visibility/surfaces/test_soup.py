"""What a soup's arrays are like, whatever they were made from."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.visibility.surfaces.soup import build_soup

CORNER = np.array([[0, 0, 0], [8, 0, 0], [0, 8, 0]], np.int32)


@pytest.mark.parametrize("count", [1, 3])
def test_columns_of_a_table_of_any_length_make_one_kind_of_array(count: int) -> None:
    """Else kernels would be compiled anew for models of one drawable, whose table's columns are not strided."""
    rows = np.zeros(count, [("id", "<u4"), ("one_sided", "?"), ("see_through", "?")])
    points = np.concatenate([CORNER + np.array([0, 0, 9 * place], np.int32) for place in range(count)])
    corners = np.arange(3 * count).reshape(-1, 3)
    soup = build_soup(
        np.arange(count), rows["one_sided"], rows["see_through"], points, corners, np.ones(count, np.int64)
    )
    assert len(soup.triangles) == count
    assert all(array.flags.c_contiguous for array in vars(soup).values() if isinstance(array, np.ndarray))
