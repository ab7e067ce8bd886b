"""No row without a value reaches linear algebra, whose kernels differ in what they make of inf and
nan.
"""

import numpy as np
import pytest

from nearlift.likelihood.finite import where_finite


@pytest.mark.parametrize("lost", [np.inf, -np.inf, np.nan])
def test_a_row_without_a_value_is_nan_throughout_and_never_multiplied(lost):
    matrix = np.arange(6.0).reshape(3, 2)
    x = np.array([[1.0, 2.0, 3.0], [4.0, lost, 6.0], [7.0, 8.0, 9.0]])

    def linear(rows):
        assert np.isfinite(rows).all()
        return rows @ matrix

    found = where_finite(linear, x)
    assert np.array_equal(found[[0, 2]], x[[0, 2]] @ matrix)
    assert np.isnan(found[1]).all()


def test_rows_that_all_have_a_value_are_passed_on_as_they_are():
    x = np.ones((2, 3))
    assert where_finite(lambda rows: rows, x) is x
    assert where_finite(lambda rows: rows[:2], np.array([1.0, np.nan, 2.0])).shape == (2,)


def test_a_row_is_the_last_axis_however_many_stand_before_it():
    x = np.ones((2, 3, 4))
    x[1, 2, 0] = np.nan
    found = where_finite(lambda rows: 2 * rows, x)
    lost = np.zeros((2, 3), dtype=bool)
    lost[1, 2] = True
    assert np.isnan(found[lost]).all()
    assert (found[~lost] == 2.0).all()
