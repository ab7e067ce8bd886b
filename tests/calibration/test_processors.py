"""Every product of the demo has the same digits whatever processor BLAS, numpy and the scans'
compiler take this one for.
"""

import pytest
from tests.calibration.processors import PROCESSORS, compare, run

pytestmark = pytest.mark.calibration


def test_every_product_has_the_same_digits_on_every_processor(tmp_path):
    for name in PROCESSORS:
        run(tmp_path / name, name)
    first, *others = PROCESSORS
    for name in others:
        found = compare(tmp_path / first, tmp_path / name)
        assert sum(d.numbers for d in found) > 1_000_000
        assert not [
            f"{name}: {d.product} at {d.where}: {d.largest:.2g}"
            for d in found
            if d.largest > d.tolerated
        ]


def test_a_changed_digit_and_a_lost_row_are_seen(tmp_path):
    for name, text in (
        ("a", '{"x": [1.0, 2.0], "y": {"z": 3.0}}'),
        ("b", '{"x": [1.0, 2.0], "y": {"z": 3.00003}}'),
        ("c", '{"x": [1.0]}'),
    ):
        (tmp_path / name / "processed").mkdir(parents=True)
        (tmp_path / name / "processed" / "p.json").write_text(text)
    (same,), (moved,), (lost,) = (compare(tmp_path / "a", tmp_path / name) for name in "abc")
    assert (same.numbers, same.largest) == (3, 0.0)
    assert (moved.where, moved.largest) == (".y.z", pytest.approx(1e-5, rel=1e-3))
    assert lost.largest == float("inf")
