"""What flights in closed loop say: the gain near the ground without the bias of feedback, and no
coefficient that the log cannot tell.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.calibration import flying
from tests.calibration.flying import FLIGHT, Craft

from nearlift.errors import NotConverged
from nearlift.fit import closed_loop
from nearlift.fit.closed_loop import Windows
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.run.store import Table
from nearlift.stages import flown
from nearlift.stages.observe import observe

from .bench_campaign import run_ingest

CRAFT = Craft()
HEIGHT = {"name": "rotor plane", "on": "height", "value": "1 mm", "scope": "campaign"}


def gain(z_hat: float) -> float:
    return flying.ground(z_hat * CRAFT.radius, CRAFT) - 1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three logs of two starts, 28 set-points each."""
    root = tmp_path_factory.mktemp("flown")
    (root / "logs").mkdir()
    for k in range(3):
        rng = np.random.default_rng(100 + k)
        starts = [flying.fly(CRAFT, rng, flying.heights(rng, 14)) for _ in range(2)]
        flying.write_csv(root / "logs" / f"l{k}.csv", flying.joined(*starts))
    (root / "trials.csv").write_text("record,boundary\nl0,ground\nl1,ground\nl2,ground\n")
    return root


def made(folder: Path, out: Path, flight: dict[str, Any], **changes: Any) -> tuple[Any, Table]:
    given = manifests.parse(flying.manifest(flight, **changes))
    _, job = run_ingest(folder, out, given)
    return given, job.read(TRIALS)


@pytest.fixture(scope="module")
def with_setpoint(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    return made(folder, tmp_path_factory.mktemp("a"), FLIGHT, uncertainty=[HEIGHT])


def at_truth(given: Any, trials: Table) -> flown.Determined:
    return flown.Determined(given, observe(trials, given, "ground"))


def test_a_curve_of_commands_lacks_no_far_one(folder: Path, tmp_path: Path) -> None:
    """Every window has a command of its own: none needs to come again far from the ground."""
    from nearlift.stages import reduce

    _, job = run_ingest(folder, tmp_path, manifests.parse(flying.manifest()))
    assert reduce.run(job).notes == ()


def test_instruments_undo_the_bias_of_feedback(with_setpoint: Any) -> None:
    windows = at_truth(*with_setpoint).windows
    ratio = closed_loop.decaying(windows.z_hat, 2.0)
    honest = closed_loop.solve(windows, ratio, closed_loop.BELIEVED[0])
    plain = Windows(
        **{
            name: getattr(windows, name)
            for name in ("log_lift", "log_command", "beside", "z_hat", "start")
        },
        instruments=None,
    )
    biased = closed_loop.solve(plain, ratio, closed_loop.BELIEVED[0])
    # gusts of 1 % of the weight: least squares takes the command for weaker than it is
    assert abs(honest.power - CRAFT.exponent) < 0.08
    assert biased.power < CRAFT.exponent - 0.08


@pytest.mark.parametrize("setpoint", [True, False])
def test_gain_and_decay_are_covered(
    folder: Path, tmp_path: Path, with_setpoint: Any, setpoint: bool
) -> None:
    """One campaign: at 95 % an honest interval misses one of its two numbers in ten."""
    flight = {k: v for k, v in FLIGHT.items() if k != "setpoint"}
    given, trials = with_setpoint if setpoint else made(folder, tmp_path, flight)
    told = at_truth(given, trials).determined()
    slope = (gain(2.01) - gain(1.99)) / 0.02
    for name, truth in (("gain_at_2", gain(2.0)), ("decay_length", -gain(2.0) / slope)):
        found = told[name]
        assert found.lo95 < truth < found.hi95
        assert found.u < 0.4 * found.value
        assert ("set-point's history" in found.holds) is setpoint
        assert {line.source for line in found.budget} >= {"stretches of flight", "motor lag"}


def test_a_coefficient_is_quoted_where_the_log_tells_it_and_refused_elsewhere(
    folder: Path, tmp_path: Path, with_setpoint: Any
) -> None:
    from nearlift import catalogue
    from nearlift.results.quotation import CoefficientResult, LargestShifts

    model = catalogue.model("sanchez_cuevas")
    plain = CoefficientResult(
        value=1.8, u=0.1, dof=20.0, unit="1", lo68=1.7, hi68=1.9, lo90=1.6, hi90=2.0, lo95=1.5,
        hi95=2.1, holds="least squares",
    )  # fmt: skip
    [name] = [p.name for p in model.parameters]
    told = at_truth(*with_setpoint).coefficients(model, {name: plain})[name]
    assert told.lo95 < CRAFT.k_b < told.hi95
    assert "height of the rotor plane" in {line.source for line in told.budget}
    assert told.doubts[-1].value == 1.8
    given, trials = with_setpoint
    bare = given.model_copy(update={"uncertainty": []})
    without = at_truth(bare, trials).coefficients(model, {name: plain})[name]
    assert without.u == np.inf
    assert without.influence == LargestShifts()
    assert (without.lo90, without.hi90) == model.parameters[0].bounds
    assert 'add [[uncertainty]] on = "height"' in without.holds
    flight = {k: v for k, v in FLIGHT.items() if k != "setpoint"}
    given, trials = made(folder, tmp_path, flight, uncertainty=[HEIGHT])
    refused = at_truth(given, trials).coefficients(model, {name: plain})[name]
    assert "log the height's set-point" in refused.holds


def test_windows_far_from_the_ground_tell_nothing() -> None:
    rng = np.random.default_rng(1)
    n = 60
    windows = Windows(
        log_lift=rng.normal(size=n),
        log_command=np.zeros(n),
        beside=np.zeros((n, 1)),
        z_hat=np.full(n, 30.0),
        start=np.zeros(n, dtype=np.int64),
        instruments=None,
    )
    with pytest.raises(NotConverged, match="not told by these windows"):
        closed_loop.solve(windows, closed_loop.decaying(windows.z_hat, np.inf), np.zeros(2))


def test_what_flights_determine_stands_first_and_what_they_cannot_is_refused() -> None:
    from nearlift.results.quotation import BoundaryResult, CoefficientResult

    gain, k_b = (
        CoefficientResult(
            value=v,
            u=u,
            dof=9.0,
            unit="1",
            lo68=v,
            hi68=v,
            lo90=v,
            hi90=v,
            lo95=v,
            hi95=v,
            holds="",
            refused=refused,
        )
        for v, u, refused in ((0.17, 0.05, None), (1.5, np.inf, "refused: no set-point"))
    )
    found = BoundaryResult(
        verdict="adequate",
        base_model="sanchez_cuevas",
        coefficients={"K_b": k_b},
        in_flight={"gain_at_2": gain},
    )
    assert found.quotable == {"gain_at_2": gain}
    assert found.refused == {"K_b": "refused: no set-point"}
