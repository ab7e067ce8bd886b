"""The programs of docs/export.md compile as printed; those for C, a Crazyflie, Python and RotorPy
give what the exported model says.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.flight.export.lift_model import c_header, exported, python_module
from nearlift.flight.quoted_lift import QuotedLift

R = 0.023
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
MODEL = catalogue.model("sanchez_cuevas")
Z_M = np.array([0.0265, 0.03, 0.05, 0.11, 0.26])
RATIO = MODEL(Z_M / R, **GEOMETRY, K_b=2.0)
PAGE = (Path(__file__).parents[2] / "docs" / "export.md").read_text()
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def program(heading: str) -> str:
    """The program printed under a heading of the page."""
    section = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (text,) = (part for part in section if part.startswith(heading + "\n"))
    (code,) = re.findall(r"```(?:c|python)\n(.*?)```", text, flags=re.DOTALL)
    return code


def test_every_program_of_the_page_is_tested() -> None:
    assert PAGE.count("```c\n") + PAGE.count("```python\n") == 7


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The export of a campaign called my-rig."""
    out = tmp_path_factory.mktemp("export")
    lift = QuotedLift(
        boundary="ground",
        model=MODEL,
        arguments=GEOMETRY,
        best={"K_b": 2.0},
        intervals={},
        draws={"K_b": np.array([1.9, 2.0, 2.1])},
        measured_z_hat=(1.14, 11.5),
    )
    about = dict.fromkeys(("nearlift", "trials_sha256", "date", "held", "source"), "x")
    whole = about | {
        "campaign": "my-rig",
        "rotor_radius_m": R,
        "boundaries": {"ground": exported(lift)},
    }
    (out / "lift_model.h").write_text(c_header(whole))
    (out / "lift_model.py").write_text(python_module(whole))
    return out


@pytest.fixture
def importable(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """`lift_model` of that export can be imported."""
    monkeypatch.syspath_prepend(str(folder))
    yield monkeypatch
    sys.modules.pop("lift_model", None)


def substitute(patch: pytest.MonkeyPatch, name: str, **content: object) -> None:
    """A module of that name, and the packages around it."""
    parts = name.split(".")
    for i in range(1, len(parts) + 1):
        patch.setitem(sys.modules, ".".join(parts[:i]), ModuleType(".".join(parts[:i])))
    vars(sys.modules[name]).update(content)


def compiled(folder: Path, where: Path, source: str) -> Path:
    (where / "program.c").write_text(source)
    strict = ("-std=c11", "-Wall", "-Wextra", "-Wdouble-promotion", "-Werror", "-Os")
    built = (f"-I{folder}", "program.c", "-o", "program")
    subprocess.run(["cc", *strict, *built], cwd=where, check=True)
    return where / "program"


def numbers(*command: object) -> np.ndarray:
    done = subprocess.run([str(c) for c in command], capture_output=True, check=True, text=True)
    return np.array(done.stdout.split(), float)


@needs_compiler
def test_c_prints_the_ratio(folder: Path, tmp_path: Path) -> None:
    found = numbers(compiled(folder, tmp_path, program("C")))
    ratio, slope, u_ratio, flag = found
    step = 1e-6
    near, at, far = MODEL(np.array([0.04 - step, 0.04, 0.04 + step]) / R, **GEOMETRY, K_b=2.0)
    assert flag == 0
    assert ratio == pytest.approx(at, rel=1e-5)
    assert slope == pytest.approx((far - near) / (2 * step), rel=1e-4)
    assert u_ratio > 0


#: The parts of the firmware's headers that the controller needs; its PID asks for the thrust 30000.
FIRMWARE = """
#pragma once
#include <stdbool.h>
#include <stdint.h>
typedef enum { controlModeLegacy, controlModeForceTorque } control_mode_t;
typedef struct { float thrust; control_mode_t controlMode; } control_t;
typedef struct { struct { float x, y, z; } position; } state_t;
typedef struct { int any; } setpoint_t;
typedef struct { int any; } sensorData_t;
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


@needs_compiler
def test_a_crazyflie_asks_for_the_thrust_over_the_ratio(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "controller_pid.h").write_text(FIRMWARE)
    built = compiled(folder, tmp_path, program("Crazyflie controller") + CALLS)
    thrust, untouched = numbers(built, *Z_M, 0.6, "nan").reshape(-1, 2).T
    np.testing.assert_allclose(3e4 / thrust[:-2], RATIO, rtol=1e-6)
    assert 1 < 3e4 / thrust[-2] < 1.005
    assert thrust[-1] == 3e4
    assert (untouched == 3e4).all()


def test_python_reads_range_and_ratio(importable: pytest.MonkeyPatch) -> None:
    names: dict[str, object] = {}
    exec(program("Python"), names)
    assert (names["low"], names["high"], names["flag"]) == (1.14, 11.5, 0)
    expected = MODEL(0.040 / R, **GEOMETRY, K_b=2.0)
    assert names["value"] == pytest.approx(expected, rel=1e-6)


def test_rotorpy_lifts_by_the_ratio(importable: pytest.MonkeyPatch) -> None:
    class Multirotor:
        k_eta = 2.3e-8
        rotor_geometry = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) * 0.0325

        def _s_dot_fn(self, t, s, cmd_rotor_speeds):  # type: ignore[no-untyped-def]
            return self.compute_body_wrench(np.zeros(3), cmd_rotor_speeds, np.zeros(3))

        def compute_body_wrench(self, body_rates, rotor_speeds, body_airspeed_vector):  # type: ignore[no-untyped-def]
            lift = np.outer(self.k_eta * rotor_speeds**2, [0, 0, 1])
            return lift.sum(axis=0), np.cross(self.rotor_geometry, lift).sum(axis=0)

    substitute(importable, "rotorpy.vehicles.multirotor", Multirotor=Multirotor)
    names: dict[str, type] = {}
    exec(program("RotorPy"), names)
    speeds = np.array([1500.0, 1600.0, 1700.0, 1800.0])
    free_force, free_moment = Multirotor()._s_dot_fn(0, np.zeros(3), speeds)
    for z, ratio in zip(Z_M, RATIO, strict=True):
        force, moment = names["NearGround"]()._s_dot_fn(0, np.array([0, 0, z]), speeds)
        np.testing.assert_allclose(force, ratio * free_force, rtol=1e-6)
        np.testing.assert_allclose(moment, ratio * free_moment, rtol=1e-6)


@pytest.mark.parametrize("heading", ["gym-pybullet-drones", "CasADi", "acados"])
def test_the_others_are_python(heading: str) -> None:
    compile(program(heading), heading, "exec")
