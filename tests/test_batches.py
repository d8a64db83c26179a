"""Rows in batches: the same values as in one go, and one shape for every call."""

import numpy as np
import pytest

from lensfit.batches import in_batches


@pytest.mark.parametrize("count", [1, 7, 8, 9, 24])
@pytest.mark.parametrize("shape", [(), (2,)])
def test_values_are_those_of_one_call(count: int, shape: tuple[int, ...]):
    rows = np.random.default_rng(0).normal(size=(count, *shape))
    shapes = set()

    def function(batch: np.ndarray) -> np.ndarray:
        shapes.add(batch.shape)
        return np.stack([batch, batch**2], -1)

    found = in_batches(function, rows, size=8)
    np.testing.assert_array_equal(found, np.stack([rows, rows**2], -1))
    assert shapes == {(8, *shape)}


def test_undefined_values_stay_with_their_row():
    rows = np.array([1.0, np.nan, 3.0])
    found = in_batches(np.sqrt, rows, size=2)
    np.testing.assert_array_equal(np.isnan(found), [False, True, False])
