"""The noise floor where a component of the scatter is absent."""

import numpy as np

from nearlift.diagnosis import noise_floor

from .simulated import RADIUS, campaign, sanchez_cuevas


def floors():
    found = []
    for seed in range(8):
        data = campaign(seed, force=0.0, visits=3)
        ratio = sanchez_cuevas(data.z_hat)
        slope = np.gradient(np.log(sanchez_cuevas(data.z_hat + np.array([[-1e-4], [0.0], [1e-4]]))), 1e-4 * RADIUS, axis=0)[1]
        columns = np.column_stack([np.eye(len(data.levels))[data.level], slope])
        found.append(noise_floor.estimate(data, np.log(data.lift_N / ratio), columns, slope)[0])
    return found


def test_a_component_that_is_absent_is_not_taken_for_known_to_be_absent(monkeypatch):
    """Scoring puts the force noise at zero in some of eight campaigns without any; half a standard error is kept, and the rest is not moved."""
    kept = floors()
    monkeypatch.setattr(noise_floor, "_not_quite_zero", lambda model, y, basis, sizes: sizes)
    bare = floors()
    absent = [i for i, noise in enumerate(bare) if noise.force_N == 0]
    assert 1 <= len(absent) < 8
    for i, (with_it, without) in enumerate(zip(kept, bare, strict=True)):
        assert with_it.force_N > 0
        assert with_it.relative == without.relative
        # 25 % throttle lifts 107 mN: what is kept is less there than the scatter that is really there
        assert with_it.force_N < 0.7 * 0.004 * 0.107 or i not in absent
    assert abs(np.mean([noise.relative for noise in kept]) - 0.004) < 0.0004
