"""The median is numpy's."""

import numpy as np
import pytest

from signals._transforms import median


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (1000,), (5, 112), (3, 4, 33)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_it_is_that_of_numpy(shape, dtype):
    values = np.random.default_rng(0).standard_normal(shape).astype(dtype)
    kept = values.copy()
    np.testing.assert_array_equal(median(values), np.median(values, axis=-1))
    np.testing.assert_array_equal(values, kept)
