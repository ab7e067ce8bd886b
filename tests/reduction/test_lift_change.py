"""Trials to cells: Delta L and its covariance, against formulas by hand and against campaigns
simulated over and over.
"""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from nearlift.reduction import lift_change
from nearlift.reduction.lift_change import CELL_COLUMNS, OWN_SCATTER
from nearlift.stages import reduce as stage
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE

STATIONS = (1.1, 1.5, 3.0, 11.0)
L_INF = {0.25: 0.1, 0.5: 0.25, 0.92: 0.55}


def ratio(z: np.ndarray) -> np.ndarray:
    return 1 + 0.2 * np.exp(-(z - 1) / 2)


def trials(
    rng: np.random.Generator,
    *,
    visits: int,
    relative: float = 0.005,
    height: float = 0.0,
    u: float = 0.0,
    stations: tuple[float, ...] = STATIONS,
) -> dict[str, np.ndarray]:
    """Every throttle at each visit; `height` (in radii) shifts all trials of a visit alike.
    Stations at inf are free air.
    """
    z = np.repeat(np.tile(stations, visits), len(L_INF))
    throttle = np.tile(list(L_INF), len(stations) * visits)
    visit = np.repeat(np.arange(len(stations) * visits), len(L_INF))
    shifted = z + (height * rng.standard_normal(len(stations) * visits))[visit]
    lift = (
        np.array([L_INF[t] for t in throttle])
        * ratio(shifted)
        * (1 + relative * rng.standard_normal(len(z)))
    )
    order = np.argsort(rng.permutation(len(stations) * visits)[visit], kind="stable")
    table = {
        "z_hat": z,
        "throttle": throttle,
        "lift_N": lift,
        "u_lift_N": np.full(len(z), u),
        "visit": visit,
    }
    return {name: column[order] for name, column in table.items()}


def reduce(**table: np.ndarray) -> SimpleNamespace:
    """Cells with their columns as arrays."""
    made = lift_change.cells(**table)
    columns = {name: made.table[name].to_numpy() for name in CELL_COLUMNS}
    return SimpleNamespace(**columns, covariance=made.covariance)


def cells(seed: int = 1, **choice: object) -> tuple[SimpleNamespace, dict[str, np.ndarray]]:
    table = trials(np.random.default_rng(seed), **choice)
    return reduce(**table), table


def test_cells_are_means_ordered_by_throttle_then_distance():
    found, table = cells(visits=3)
    assert list(zip(found.throttle, found.z_hat, strict=True)) == [
        (t, z) for t in L_INF for z in STATIONS
    ]
    for i, (t, z) in enumerate(zip(found.throttle, found.z_hat, strict=True)):
        mine = (table["throttle"] == t) & (table["z_hat"] == z)
        assert found.lift_N[i] == pytest.approx(table["lift_N"][mine].mean(), rel=1e-14)
        assert found.n_trials[i] == mine.sum() == 3
    far = found.lift_N.reshape(3, -1)[:, -1:]
    assert found.delta_L.reshape(3, -1) == pytest.approx((found.lift_N.reshape(3, -1) - far) / far)


def test_the_farthest_station_is_exactly_nothing_with_exactly_no_variance():
    found, _ = cells(visits=8, height=0.02)
    far = found.z_hat == STATIONS[-1]
    assert (found.delta_L[far] == 0).all()
    assert (found.covariance()[far] == 0).all()
    assert (found.covariance()[:, far] == 0).all()
    assert (np.diag(found.covariance())[~far] > 0).all()


def test_free_air_is_the_reference_where_there_is_any():
    found, table = cells(visits=5, stations=(*STATIONS, np.inf))
    assert np.isfinite(found.z_hat).all()
    for t in L_INF:
        air = table["lift_N"][np.isinf(table["z_hat"]) & (table["throttle"] == t)].mean()
        mine = found.throttle == t
        assert found.delta_L[mine] == pytest.approx(found.lift_N[mine] / air - 1)
    # the farthest station is now an ordinary cell, but of a throttle that never ran in free air
    assert (np.diag(found.covariance())[found.z_hat == STATIONS[-1]] > 0).all()
    keep = ~(np.isinf(table["z_hat"]) & (table["throttle"] == 0.5))
    part = reduce(**{name: column[keep] for name, column in table.items()})
    far = part.z_hat == STATIONS[-1]
    assert part.delta_L[far & (part.throttle == 0.5)] == 0
    assert (part.delta_L[far & (part.throttle != 0.5)] != 0).all()


def test_cells_of_one_throttle_share_L_inf_and_others_nothing():
    """By hand: cov(d_i, d_j) = m_i m_j / m_far^4 var(m_far) for i != j, and var(m_i) / m_far^2 more
    on the diagonal.
    """
    found, _ = cells(visits=OWN_SCATTER)  # too few for a joint scatter over throttles
    m, u2 = found.lift_N.reshape(3, -1), found.u_lift_N.reshape(3, -1) ** 2
    expected = np.zeros((12, 12))
    for k in range(3):
        block = np.outer(m[k], m[k]) / m[k, -1] ** 4 * u2[k, -1] + np.diag(u2[k] / m[k, -1] ** 2)
        block[-1], block[:, -1] = 0, 0
        expected[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] = block
    assert found.covariance() == pytest.approx(expected, rel=1e-10, abs=1e-20)


@pytest.mark.parametrize("height", [0.0, 0.1])
@pytest.mark.nightly
def test_the_covariance_is_that_of_campaigns_simulated_again_and_again(height):
    """Sample covariance of Delta L over N campaigns against the mean of what each says of itself.

    Its standard error is sqrt((c_ij^2 + c_ii c_jj) / N). 66 different entries at 4.5 sigma cry wolf
    once in two thousand. Curvature of the ratio (second order in height) may add 2 % of the
    standard deviations' product.
    """
    many, rng = 400, np.random.default_rng(11)
    found = [reduce(**trials(rng, visits=10, height=height)) for _ in range(many)]
    near = found[0].z_hat < STATIONS[-1]
    sample = np.cov(np.array([f.delta_L[near] for f in found]).T)
    stated = np.mean([f.covariance()[np.ix_(near, near)] for f in found], axis=0)
    scale = np.outer(np.diag(sample), np.diag(sample))
    assert (
        np.abs(sample - stated) < 4.5 * np.sqrt((sample**2 + scale) / many) + 0.02 * np.sqrt(scale)
    ).all()
    across = (sample / np.sqrt(scale))[0, 3]  # one station, two throttles
    assert abs(across) < 0.2 if height == 0 else across > 0.5


def test_a_visits_height_is_seen_only_where_every_throttle_was_run_at_each():
    table = trials(np.random.default_rng(3), visits=10, height=0.1)
    whole = reduce(**table)
    lost = np.flatnonzero((table["z_hat"] == 1.1) & (table["throttle"] == 0.5))[0]
    part = reduce(**{name: np.delete(column, lost) for name, column in table.items()})
    i, j = (np.flatnonzero((whole.z_hat == 1.1) & (whole.throttle == t))[0] for t in (0.25, 0.92))

    def joint(station: float) -> float:
        lifts = [
            table["lift_N"][(table["z_hat"] == station) & (table["throttle"] == t)]
            for t in (0.25, 0.92)
        ]
        return float(np.cov(lifts)[0, 1]) / 10

    # by hand: each station's own visits, and those of the farthest through L_inf
    far, m = (
        whole.lift_N[
            [np.flatnonzero((whole.z_hat == z) & (whole.throttle == t))[0] for t in (0.25, 0.92)]
        ]
        for z in (11.0, 1.1)
    )
    through_far = m.prod() / far.prod() ** 2 * joint(11.0)
    assert whole.covariance()[i, j] == pytest.approx(
        joint(1.1) / far.prod() + through_far, rel=1e-9
    )
    assert part.covariance()[i, j] == pytest.approx(through_far, rel=1e-9)
    assert abs(joint(1.1) / far.prod()) > 2 * abs(through_far)


def test_few_repeats_borrow_the_scatter_of_all():
    """Below OWN_SCATTER trials a cell takes the pooled relative scatter, over its own count; with
    as many, its own.
    """
    table = trials(np.random.default_rng(5), visits=3)
    found = reduce(**table)
    label = [
        np.flatnonzero((found.z_hat == z) & (found.throttle == t))[0]
        for z, t in zip(table["z_hat"], table["throttle"], strict=True)
    ]
    relative = table["lift_N"] / found.lift_N[label] - 1
    pooled = np.sum(relative**2) / (len(relative) - len(found.z_hat))
    assert found.u_lift_N == pytest.approx(np.sqrt(pooled / 3) * found.lift_N)
    own, many = cells(5, visits=OWN_SCATTER)
    mine = many["lift_N"][(many["z_hat"] == 1.5) & (many["throttle"] == 0.5)]
    assert own.u_lift_N[(own.z_hat == 1.5) & (own.throttle == 0.5)] == pytest.approx(
        mine.std(ddof=1) / np.sqrt(len(mine))
    )


def test_repeats_that_agree_by_luck_are_no_better_than_their_records():
    for visits in (1, 5):
        found, _ = cells(visits=visits, relative=0.0, u=0.002)
        assert found.u_lift_N == pytest.approx(np.full(12, 0.002 / np.sqrt(visits)))
        assert (found.n_trials == visits).all()


def test_the_covariance_is_one():
    """Symmetric, its diagonal the squared uncertainties, and no combination of cells has a negative
    variance.
    """
    for visits, air in product((1, 3, 9), ((), (np.inf,))):
        found, _ = cells(visits=visits, height=0.05, u=1e-4, stations=(*STATIONS, *air))
        assert np.diag(found.covariance()) == pytest.approx(found.u_delta_L**2, rel=1e-12)
        assert (found.covariance() == found.covariance().T).all()
        assert np.linalg.eigvalsh(found.covariance()).min() > -1e-12 * np.trace(found.covariance())


def test_beyond_so_many_cells_the_covariance_is_left_empty_and_said_so(remake, monkeypatch):
    """Its size grows with the square of the cells; what each one's uncertainty is stays, to the
    last bit.
    """
    job = remake()
    usual = job.read(LIFT)
    assert len(job.read(LIFT_COVARIANCE)) == len(usual["delta_L"])
    monkeypatch.setattr(lift_change, "MOST_CELLS", len(usual["delta_L"]) - 1)
    [note] = [n for n in stage.run(job).notes if "covariance" in n]
    assert note.startswith(f"{len(usual['delta_L'])} cells: their covariance would be ")
    assert job.read(LIFT_COVARIANCE) == {}
    for name, column in job.read(LIFT).items():
        np.testing.assert_array_equal(column, usual[name])
