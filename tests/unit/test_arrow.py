"""Arrow arrays as numpy ones, without pandas."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from nearlift.readers import table


@pytest.mark.parametrize(("start", "length"), [(0, 5), (1, 3), (2, 1), (1, 0)])
def test_a_null_is_not_a_number_and_its_neighbours_are_themselves(start, length):
    whole = pa.array([1.5, None, 3.5, None, 5.5])
    expected = np.array([1.5, np.nan, 3.5, np.nan, 5.5])[start : start + length]
    np.testing.assert_array_equal(table.floats(whole.slice(start, length)), expected)


def test_whole_numbers_and_columns_of_nothing():
    np.testing.assert_array_equal(table.floats(pa.array([7, None, -2])), [7, np.nan, -2])
    np.testing.assert_array_equal(table.floats(pa.nulls(2)), [np.nan, np.nan])


def test_one_blank_cell_does_not_load_pandas():
    """Found by fuzzing: it made the first such record wait for an import of up to seconds."""
    code = (
        "import sys; from nearlift.readers import csv_trial\n"
        "try: csv_trial.parse(b't,force\\n,5\\n0.1,6\\n0.2,7\\n', 'f', 'force', 't')\n"
        "finally: sys.exit('pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
