"""What flight adds: named where a simulated vehicle has it, and not where it has not; the physics of
the simulation is written apart from the effects' formulas.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.calibration import flying, in_flight
from tests.calibration.flying import FLIGHT, Craft

from nearlift import catalogue, readers
from nearlift.errors import NotConverged
from nearlift.likelihood import budget
from nearlift.likelihood.covariance import Covariance
from nearlift.likelihood.covariates import derive
from nearlift.loop import search_problem
from nearlift.loop.admission import admit, could_act
from nearlift.loop.diagnose import diagnose, set_up
from nearlift.loop.families import families
from nearlift.loop.search_problem import Options
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.readers import flights
from nearlift.reduction import motor_lag
from nearlift.results import Observations
from nearlift.stages.observe import observe

from .bench_campaign import run_ingest

BASE = catalogue.model("sanchez_cuevas")
#: Gusts of 3 % of the weight that last a tenth of a second, answered by the controller.
GUSTY = Craft(climb=0.0, gust_N=0.009, gust_s=0.1)


# ---- physics


@pytest.mark.parametrize("blades", [0.3, 0.6, 1.2])
def test_inflow_is_that_of_blades_and_momentum(blades: float) -> None:
    craft = Craft(blades=blades)
    hover = np.sqrt(craft.mass * flying.G / (2 * 1.2 * 4 * np.pi * craft.radius**2))
    # what blades lose of thrust draws less inflow in turn
    size = 2 * blades / (2 + blades)
    climb, level = catalogue.effect("climb_inflow"), catalogue.effect("translational_lift")
    for speed in (-0.8, -0.3, 0.3, 0.8):
        told = climb(1.0, climb_hat=speed / hover, climb_loss=size)
        true = flying.inflow(speed, 0.0, craft)
        assert abs(told - true) < 0.05 * abs(true - 1)
    for speed in (1.0, 2.5, 4.0):
        told = level(1.0, level_speed_hat=speed / hover, level_gain=size)
        true = flying.inflow(0.0, speed, craft)
        assert abs(told - true) < 0.15 * abs(true - 1)


@pytest.mark.parametrize("health", [0.98, 0.94, 0.85])
def test_a_worse_rotor_costs_what_the_others_are_told_less(health: float) -> None:
    sound, worse = Craft(), Craft(health=(1.0, health, 1.0, 1.0))
    shares, lift = flying.trimmed(worse)
    imbalance = -np.log(min(np.array(shares) / np.array(sound.shares)))
    told = catalogue.effect("rotor_imbalance")(
        1.0, imbalance=imbalance, imbalance_power=sound.exponent
    )
    assert abs(told - lift) < 0.02 * (1 - lift)


# ---- the loop


#: It flies fast besides, which makes its search the longest.
LONG = "translational lift"
SHORT = [kind for kind in in_flight.KINDS if kind != LONG]


@pytest.mark.parametrize("kind", [*SHORT, pytest.param(LONG, marks=pytest.mark.calibration)])
def test_what_is_there_is_named(kind: str) -> None:
    """Strong ones; on what `in_flight` finds of many campaigns see docs/flights.md."""
    found = in_flight.row(kind, 700_001)
    right = set(in_flight.KINDS[kind])
    if not right:
        assert found["verdict"] == "adequate"
        return
    assert found["verdict"] == "effect"
    assert right & {*found["named"], *found["rivals"]}
    if kind == "a worse rotor":
        # in hover nothing parts them
        assert {"rotor_imbalance", "weight_at_rotor"} <= {*found["named"], *found["rivals"]}
        # and what is worse for one session is a gain of it
        assert "session_gain" in {*found["named"], *found["rivals"]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("flown")
    in_flight.record(root, GUSTY, "nothing", np.random.default_rng(31))
    return root


@pytest.fixture(scope="module")
def campaign(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    return _observed(folder, tmp_path_factory.mktemp("out"), FLIGHT)


def _observed(folder: Path, out: Path, flight: dict[str, Any], **changes: Any) -> Any:
    given = manifests.parse(flying.manifest(flight, **changes))
    _, job = run_ingest(folder, out, given)
    return given, observe(job.read(TRIALS), given, "ground")


def test_a_wrong_mass_is_silent_and_changes_nothing_else(
    folder: Path, campaign: Any, tmp_path: Path
) -> None:
    raw = flying.manifest()
    heavy = {**raw["vehicle"], "mass": "36 g"}
    blocks = []
    for given, data in (campaign, _observed(folder, tmp_path, FLIGHT, vehicle=heavy)):
        found = diagnose(data, BASE, budget.components(given), Options(), confirm=False)
        assert found.findings.verdict == "adequate"
        [told] = [s for s in found.findings.silent or () if s.effect == "vehicle_mass"]
        assert (told.absorbed_by, told.bias_at_detection_limit) == ("L_inf", 0.0)
        blocks.append(found.findings.coefficients.after["K_b"].value)
    assert abs(blocks[1] - blocks[0]) < 1e-3


def test_feedback_is_no_structure(
    folder: Path, campaign: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Flights with nothing in them: by all that lift shares with the command they hold a lot; and
    without a set-point they are not diagnosed.
    """
    given, data = campaign
    parts = budget.components(given)
    seen = set_up(data, BASE, parts, Options())[0].nothing_added[0]
    assert not seen.present
    monkeypatch.setattr(search_problem, "instruments", lambda data: None)
    assert set_up(data, BASE, parts, Options())[0].nothing_added[0].p_value < 0.01
    said = {k: v for k, v in FLIGHT.items() if k != "setpoint"}
    given, bare = _observed(folder, tmp_path, said)
    with pytest.raises(NotConverged, match=r"feedback looks like structure.*\n.*set-point"):
        admit("diagnosis of the ground", bare, BASE)


def test_bookkeeping_and_stands_have_no_family(campaign: Any) -> None:
    _, data = campaign
    data = derive(data, np.full(data.n, 0.32))
    along = {f.covariate for f in families(data)}
    assert not along & {"flight", "order_in_visit", "previous_throttle", "previous_distance"}
    assert not any(name.startswith("setpoint") for name in along)
    assert {"climb_m_s", "lag_slope", "distance", "start"} <= along
    known, missed = could_act(data, BASE)
    names = {e.name for e in known}
    assert not names & {"cell_creep", "tether_stiffness", "cell_nonlinearity", "approach_backlash"}
    assert {"climb_inflow", "motor_lag", "rotor_imbalance", "vehicle_mass"} <= names
    assert "translational_lift" in {u.effect for u in missed}


def tethered(**covariates: Any) -> Observations:
    n = 60
    z_hat = np.tile(np.geomspace(1, 10, 6), n // 6)
    return Observations(
        boundary="ground",
        trial=np.arange(n).astype(str),
        z_hat=z_hat,
        lift_N=np.full(n, 0.3),
        u_lift_N=np.zeros(n),
        n_eff=np.ones(n),
        throttle=np.tile([0.4, 0.6], n // 2),
        visit=np.arange(n),
        session=np.zeros(n, dtype=np.int64),
        radius_m=0.023,
        geometry={"layout_hat": np.ones((4, 2)), "spacing_hat": 2.8, "diagonal_hat": 4.0},
        covariates=covariates,
    )


def test_a_stand_tests_what_it_logs_and_is_not_asked_to_fly() -> None:
    plain = derive(tethered(), np.full(60, 0.3))
    known, missed = could_act(plain, BASE)
    of_flight = {e.name for e in catalogue.effects() if e.belongs_to == "flight"}
    assert not of_flight & {*(e.name for e in known), *(u.effect for u in missed)}
    moved = derive(tethered(climb_m_s=np.linspace(-0.2, 0.2, 60)), np.full(60, 0.3))
    known, _ = could_act(moved, BASE)
    assert of_flight & {e.name for e in known} == {"climb_inflow"}
    induced = np.sqrt(0.3 / (2 * 1.2 * 4 * np.pi * 0.023**2))
    np.testing.assert_allclose(moved.covariates["climb_hat"][-1], 0.2 / induced, rtol=1e-12)


# ---- instruments


def test_instruments_see_through_the_covariance() -> None:
    rng = np.random.default_rng(4)
    n = 40
    z, shared = rng.normal(size=(n, 5)), rng.normal(size=(n, 2))
    plain = Covariance(
        variance=rng.uniform(0.5, 2, n), visit=np.arange(n) // 3, per_visit=rng.normal(size=n),
        shared=np.zeros((n, 0)), common=0.3,
    )  # fmt: skip
    seeing = dataclasses.replace(plain, instruments=z, shared=shared)
    precision = np.linalg.inv(plain.dense())
    # of the moments Z' C^-1 e, whose covariance shared unknowns add to
    moments = z.T @ precision
    spread = moments @ z + moments @ shared @ shared.T @ moments.T
    expected = moments.T @ np.linalg.inv(spread) @ moments
    found = seeing.unwhiten(seeing.whiten(np.eye(n)))
    np.testing.assert_allclose(found, expected, atol=1e-10)


# ---- lag


def test_the_set_point_tells_the_lag_that_feedback_biases(tmp_path: Path) -> None:
    craft = GUSTY
    given = manifests.parse(flying.manifest())
    stretches = []
    for k in range(3):
        rng = np.random.default_rng(200 + k)
        starts = [flying.fly(craft, rng, flying.heights(rng, 20)) for _ in range(2)]
        flying.write_csv(tmp_path / f"{k}.csv", flying.joined(*starts))
        log = flights.read(given, tmp_path, readers.reader("text"), tmp_path / f"{k}.csv", 0.03)
        assert isinstance(log, flights.Weighed)
        stretches += log.stretches
    honest = motor_lag.estimate(stretches)
    plain = motor_lag.estimate([dataclasses.replace(s, seen=None) for s in stretches])
    assert honest is not None
    assert plain is not None
    assert abs(honest.value_s - craft.lag_s) < 2.6 * honest.u_s
    # least squares is off by more than its scatter, and its uncertainty holds that
    assert plain.value_s > craft.lag_s + 0.006
    assert abs(plain.value_s - craft.lag_s) < 2.6 * plain.u_s
