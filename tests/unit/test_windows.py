"""Windows of flight, some of them taken: every column goes along."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nearlift.fit.closed_loop import Windows


@pytest.mark.parametrize("logged", [True, False])
def test_what_is_taken_of_windows_is_their_rows(logged: bool) -> None:
    """Instruments where a set-point was logged, and none where it was not."""
    n = np.arange(4.0)
    windows = Windows(
        log_lift=n,
        log_command=n + 10,
        beside=np.stack([n, -n], axis=1),
        z_hat=n + 1,
        start=np.array([0, 0, 1, 1]),
        instruments=np.stack([n, n**2], axis=1) if logged else None,
    )
    kept = np.array([True, False, False, True])
    found = windows.taken(kept)
    for field in dataclasses.fields(Windows):
        whole, part = getattr(windows, field.name), getattr(found, field.name)
        assert (part is None) == (whole is None)
        if whole is not None:
            assert np.array_equal(part, whole[[0, 3]])
