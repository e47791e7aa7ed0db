import numpy as np
import pytest
from hypothesis import given

from storage.cells.deltas import Delta, apply, difference
from tests.storage.strategies import id_sets

SETS = id_sets(largest=80)


@given(SETS, SETS)
def test_a_difference_leads_from_one_set_to_the_other_and_back(a: np.ndarray, b: np.ndarray) -> None:
    delta = difference(a, b)
    assert set(delta.added) == set(b) - set(a)
    assert set(delta.dropped) == set(a) - set(b)
    assert np.array_equal(apply(a, delta), b)
    assert np.array_equal(apply(b, delta.reversed()), a)


def test_changes_that_do_not_fit_are_refused() -> None:
    ids, none = np.array([1, 2], np.uint32), np.zeros(0, np.uint32)
    with pytest.raises(ValueError, match="drops"):
        apply(ids, Delta(none, np.array([3], np.uint32)))
    with pytest.raises(ValueError, match="adds"):
        apply(ids, Delta(np.array([2], np.uint32), none))
