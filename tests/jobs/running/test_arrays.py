"""Arrays as files."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.running.arrays import mapped_array, save_array


def test_arrays_come_back_mapped_and_read_only(tmp_path) -> None:
    array = np.arange(12.0).reshape(3, 4)
    save_array(tmp_path / "a.npy", array)
    found = mapped_array(tmp_path / "a.npy")
    assert type(found) is np.ndarray
    assert np.array_equal(found, array)
    with pytest.raises(ValueError, match="read-only"):
        found[0, 0] = 1
    save_array(tmp_path / "none.npy", array[:0])
    assert mapped_array(tmp_path / "none.npy").shape == (0, 4)
