"""The examples that fly: each asks for, or gives, what the export says at the same height."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.flight.export import c_header, python_module
from nearlift.flight.export.model_export import ModelExport, exported
from nearlift.flight.fitted_lift import FittedLift

FLIGHT = Path(__file__).parents[2] / "examples" / "flight"
R = 0.023
Load = Callable[[str], ModuleType]
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
MODEL = catalogue.model("sanchez_cuevas")
#: From above contact to beyond the last station.
Z_M = np.array([0.0265, 0.03, 0.05, 0.11, 0.26, 0.6])
WITHIN = Z_M < 11.5 * R
RATIO = MODEL(Z_M[WITHIN] / R, **GEOMETRY, K_b=2.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a campaign called rig exports."""
    out = tmp_path_factory.mktemp("export")
    lift = FittedLift(
        boundary="ground",
        model=MODEL,
        arguments=GEOMETRY,
        best={"K_b": 2.0},
        intervals={},
        number=3,
        draws={"K_b": np.array([1.9, 2.0, 2.1])},
        source="draws",
        measured_z_hat=(1.14, 11.5),
    )
    whole = ModelExport(
        campaign="rig",
        nearlift="0",
        digest="0",
        date="unknown",
        source="results.json",
        radius_m=R,
        held="throttle",
        lifts=(exported(lift),),
    )
    (out / "lift_model.h").write_text(c_header.header(whole))
    (out / "lift_model.py").write_text(python_module.module(whole))
    (out / "lift_model_casadi.py").write_text(python_module.casadi(whole))
    return out


@pytest.fixture
def load(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Load]:
    """Import an example beside this export."""
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.syspath_prepend(str(FLIGHT))

    def one(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield one
    for name in {"lift_model", "lift_model_casadi"} | {p.stem for p in FLIGHT.glob("*.py")}:
        sys.modules.pop(name, None)


#: What of the firmware's headers the controller looks at, and one that asks for the thrust 30000.
FIRMWARE = """
#include <stdbool.h>
#include <stdint.h>
#define M2T(x) (x)
typedef enum { controlModeLegacy, controlModeForceTorque } control_mode_t;
typedef struct { float thrust; control_mode_t controlMode; } control_t;
typedef struct { struct { float x, y, z; } position; } state_t;
typedef struct { int any; } setpoint_t;
typedef struct { int any; } sensorData_t;
static inline void vTaskDelay(int ticks) { (void)ticks; }
static inline void controllerPidInit(void) {}
static inline bool controllerPidTest(void) { return true; }
static inline void controllerPid(control_t *c, const setpoint_t *p, const sensorData_t *s,
                                 const state_t *t, const uint32_t k)
{
    (void)p; (void)s; (void)t; (void)k;
    c->thrust = 30000.0f;
}
"""
CALLS = """
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **z)
{
    for (int i = 1; i < count; i++) {
        const setpoint_t to = {0};
        const sensorData_t of = {0};
        const state_t at = {{0.0f, 0.0f, strtof(z[i], 0) - STANDING_M}};
        control_t legacy = {0.0f, controlModeLegacy}, other = {0.0f, controlModeForceTorque};
        controllerOutOfTree(&legacy, &to, &of, &at, 0);
        controllerOutOfTree(&other, &to, &of, &at, 0);
        printf("%.9g %.9g\\n", (double)legacy.thrust, (double)other.thrust);
    }
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_a_crazyflie_asks_for_the_thrust_over_the_ratio(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "firmware.h").write_text("#pragma once\n" + FIRMWARE)
    for name in ("FreeRTOS.h", "app.h", "controller.h", "controller_pid.h", "task.h"):
        (tmp_path / name).write_text('#include "firmware.h"\n')
    source = (FLIGHT / "feed_forward.c").read_text() + CALLS
    (tmp_path / "calls.c").write_text(source)
    strict = ("-std=c11", "-Wall", "-Wextra", "-Wdouble-promotion", "-Werror", "-Os")
    built = ("-DGROUND=nearlift_rig_ground", f"-I{folder}", "calls.c", "-o", "calls")
    subprocess.run(["cc", *strict, *built], cwd=tmp_path, check=True)
    done = subprocess.run(
        [tmp_path / "calls", *map(str, Z_M), "nan"], capture_output=True, check=True, text=True
    )
    thrust, untouched = np.array([line.split() for line in done.stdout.split("\n")[:-1]], float).T
    np.testing.assert_allclose(3e4 / thrust[:-1][WITHIN], RATIO, rtol=1e-6)
    assert 1 < 3e4 / thrust[-2] < 1.005
    assert thrust[-1] == 3e4
    assert (untouched == 3e4).all()


def test_rotors_of_pybullet_gain_each_by_its_height(load: Load) -> None:
    drones = load("pybullet_near_ground")
    more = drones.gained_N(2e-10, np.full(len(Z_M), 16e3), Z_M, R)
    np.testing.assert_allclose(1 + more[WITHIN] / (2e-10 * 16e3**2), RATIO, rtol=1e-6)


def test_an_aviary_flies_with_them(load: Load) -> None:
    pytest.importorskip("pybullet", reason="pybullet is not installed")
    envs = pytest.importorskip(
        "gym_pybullet_drones.envs.CtrlAviary", reason="gym-pybullet-drones is not installed"
    )
    kinds = pytest.importorskip("gym_pybullet_drones.utils.enums")
    drones = load("pybullet_near_ground")
    heights = []
    for aviary in (envs.CtrlAviary, drones.near_ground(envs.CtrlAviary, R)):
        physics = kinds.Physics.PYB if aviary is envs.CtrlAviary else kinds.Physics.PYB_GND
        env = aviary(initial_xyzs=np.array([[0.0, 0.0, 0.05]]), physics=physics)
        for _ in range(20):
            seen, *_ = env.step(np.full((1, 4), env.HOVER_RPM))
        heights.append(seen[0][2])
        env.close()
    assert heights[1] > heights[0]


def test_rotorpy_lifts_by_the_ratio_and_hovers_where_the_controller_knows_it(load: Load) -> None:
    pytest.importorskip("rotorpy", reason="rotorpy is not installed")
    near = load("rotorpy_near_ground")
    speeds = np.array([1500.0, 1600.0, 1700.0, 1800.0])
    still = np.zeros(3)
    for z, ratio in zip(Z_M[WITHIN], RATIO, strict=True):
        vehicle = near.NearGround(near.quad_params, R, aero=False)
        vehicle.z_m = z
        force, moment = vehicle.compute_body_wrench(still, speeds, still)
        alone, turn = super(near.NearGround, vehicle).compute_body_wrench(still, speeds, still)
        assert force[2] / alone[2] == pytest.approx(ratio, rel=1e-6)
        np.testing.assert_allclose(moment[:2], ratio * turn[:2], rtol=1e-6)
    ends = [
        near.land(vehicle, R, known)[1][-1]
        for vehicle, known in (
            (near.Multirotor(near.quad_params), False),
            (near.NearGround(near.quad_params, R), False),
            (near.NearGround(near.quad_params, R), True),
        )
    ]
    assert ends[0] == pytest.approx(0.03, abs=1e-3)
    assert ends[1] > ends[0] + 0.005
    assert ends[2] == pytest.approx(ends[0], abs=1e-3)


def test_casadi_flies_the_export_and_lands(load: Load) -> None:
    ca = pytest.importorskip("casadi", reason="casadi is not installed")
    vertical = load("casadi_vertical")
    state, command, slope = vertical.dynamics(R)
    flow = ca.Function("flow", [state, command], [slope])
    for z, ratio in zip(Z_M[WITHIN], RATIO, strict=True):
        speed, climb = np.array(flow([z, 0.3], 0.9)).ravel()
        assert speed == 0.3
        assert climb == pytest.approx(9.80665 * (0.9 * ratio - 1), rel=1e-6)
    z, v, u = vertical.landing(R, 0.2)
    assert z[-1] == pytest.approx(1.14 * R, abs=1e-6)
    assert abs(v[-1]) < 1e-6
    assert (z >= 1.14 * R - 1e-6).all()
    # on the way it gives the weight's whole impulse, of which the ground takes its part
    assert 0.85 < u.mean() < 0.99
