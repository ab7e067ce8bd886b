"""The demo's answers do not depend on the processor that BLAS, numpy and numba take this one for."""

import pytest
from tests.calibration.processors import PROCESSORS, SAME_IN_U, answers, differences, verdicts

pytestmark = pytest.mark.calibration


def test_every_processor_gives_the_same_answers(tmp_path):
    first, *others = (answers(tmp_path / name, name) for name in PROCESSORS)
    for other in others:
        assert verdicts(other) == verdicts(first)
        assert max(differences(first, other).values()) < SAME_IN_U
