import numpy as np
import pytest

from causalbench.core.numerics import limits


@pytest.mark.parametrize("shape", [(7,), (3, 7), (0,)])
def test_the_largest_magnitude_is_numpys(shape):
    values = np.random.default_rng(0).normal(size=shape)
    assert np.array_equal(limits.largest(values), abs(values).max(axis=-1, initial=0.0))


def test_nan_is_the_largest_wherever_it_stands():
    for place in range(3):
        values = np.array([0.5, -2.0, 1.0])
        values[place] = np.nan
        assert np.isnan(limits.largest(values))


def test_within_clips_as_numpy_does():
    values = np.array([[-9.0, -1.0, 0.3], [np.inf, np.nan, 4.0]])
    found = limits.within(values, 3.0)
    assert found.dtype == np.float32
    assert np.array_equal(found, np.clip(values, -3.0, 3.0).astype(np.float32), equal_nan=True)
