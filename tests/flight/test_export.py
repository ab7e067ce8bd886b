"""Exported models: compiled C, the Python module and JSON agree with the model over its range."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit import quoted
from tests.unit.manifests import raw_manifest

from nearlift import catalogue
from nearlift.declare import compose
from nearlift.errors import InputRefused
from nearlift.flight.export.lift_model import c_header, exported
from nearlift.flight.export.table import LiftTable, lift_table
from nearlift.results import Estimate
from nearlift.results.document import typed
from nearlift.run import tables
from nearlift.stages import export as controller
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS

SIDES = ("ground", "ceiling", "sidewall")
GCC = shutil.which("gcc") or shutil.which("cc")
needs_compiler = pytest.mark.skipif(GCC is None, reason="no C compiler on this machine")
#: A float carries 6e-8; the table is within 1.5e-7 of the model, and either form takes some ten
#: roundings. A slope, relative to the largest, is a difference of them.
FLOAT, SLOPE = 2e-6, 2e-4


@pytest.fixture(scope="module")
def job(remake):
    """A fitted campaign whose ceiling saturates, as the loop would say."""
    job = remake()
    (job.root / "campaign.toml").write_text("")
    os.utime(job.root / "campaign.toml", (1.6e9, 1.6e9))

    def about(value, half):
        return {"value": value, "lo90": value - half, "hi90": value + half}

    sizes = {"gap_hat2": about(0.02, 0.01), "saturation_power": about(0.68, 0.0)}
    block = {
        "verdict": "effect",
        "effects": [{"name": "near_wall_saturation", "parameters": sizes}],
        "coefficients": {"after": {"alpha": about(0.1, 0.01)}},
    }
    job.write(DIAGNOSIS, quoted.diagnosis({"ceiling": block}))
    quoted.write(job, {"ceiling": block})
    return job


@pytest.fixture(scope="module")
def lifts(job):
    return {side: quoted.fitted_lift(job, side, 2) for side in SIDES}


def whole(lift):
    """A campaign's export of one boundary."""
    about = dict.fromkeys(("nearlift", "trials_sha256", "date", "held", "source"), "x")
    return about | {"campaign": "c", "rotor_radius_m": 0.023, "boundaries": {"ground": lift}}


# ---- C


COMPILERS = [c for c in ("gcc", "clang", "clang-19") if shutil.which(c)]
STRICT = [
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
]
FLAGS = [
    (level, *fast)
    for level in ("-O0", "-O1", "-O2", "-O3", "-Os")
    for fast in ((), ("-ffast-math",))
]
#: Reads numbers, writes what each function makes of them, so that no compiler sees a NaN coming.
PROGRAM = """
#include "lift_model.h"
#include <stdio.h>
#include <string.h>
static int put(double a, double b, double c, int flag)
{
    const double row[4] = {a, b, c, (double)flag};
    return fwrite(row, sizeof row, 1, stdout) != 1;
}
#define LIFT(name) \\
    if (!strcmp(argv[1], #name)) { \\
        while (fread(z, sizeof *z, 1, stdin) == 1) { \\
            const nearlift_lift f = CAMPAIGN(name)(*z); \\
            if (put((double)f.ratio, (double)f.slope, (double)f.u_ratio, f.flag)) return 1; \\
        } \\
    }
int main(int argc, char **argv)
{
    nearlift_real z[1];
    if (argc != 2) return 1;
    LIFT(ground) LIFT(ceiling) LIFT(sidewall)
    return 0;
}
"""


@pytest.fixture(scope="module")
def named(job):
    """The campaign's name in C, and the header."""
    header = Path(controller.write_c(job))
    return re.search(r"nearlift_lift nearlift_(\w+)_ground\(", header.read_text())[1], header


def build(folder, named, compiler, *flags):
    """A program that calls every function of the header."""
    name, header = named
    shutil.copy(header, folder)
    (folder / "calls.c").write_text(f"#define CAMPAIGN(name) nearlift_{name}_##name\n{PROGRAM}")
    subprocess.run([compiler, *STRICT, *flags, "calls.c", "-o", "calls"], cwd=folder, check=True)
    real = np.float64 if "-DNEARLIFT_DOUBLE" in flags else np.float32

    def call(function, values):
        done = subprocess.run(
            [folder / "calls", function],
            input=np.asarray(values, dtype=real).tobytes(),
            capture_output=True,
            check=True,
        )
        return np.frombuffer(done.stdout).reshape(-1, 4)

    return call, real


@needs_compiler
@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_compiled_header_is_the_model(job, named, lifts, tmp_path, compiler, precision):
    """Whatever the compiler, the optimisation, -ffast-math and the precision."""
    doubles = precision == "double"
    for flags in FLAGS[4:8] if doubles else FLAGS:
        extra = ("-DNEARLIFT_DOUBLE",) if doubles else ()
        call, real = build(tmp_path, named, compiler, *flags, *extra)
        for side in SIDES:
            lift, radius = lifts[side], job.campaign.vehicle.rotor_radius
            z_m = (radius * np.geomspace(*lift.measured_z_hat, 4001))[1:-1].astype(real)
            # the model at the very number that C was given
            z_hat = z_m.astype(float) / (radius if doubles else float(np.float32(radius)))
            truth = lift.ratio()(z_hat)
            slope = (lift.ratio()(z_hat + 1e-6) - lift.ratio()(z_hat - 1e-6)) / (2e-6 * radius)
            where = f"{compiler} {flags} {side}"
            at = call(side, z_m)
            assert not at[:, 3].any(), where
            assert np.max(np.abs(at[:, 0] / truth - 1)) < (2e-7 if doubles else FLOAT), where
            steepest = np.max(np.abs(slope))
            assert np.max(np.abs(at[:, 1] - slope)) < SLOPE * steepest, where
            outside(call, lift, side, radius, where)


def outside(call, lift, side, radius, where):
    """NaN and what lies out of range are flagged; beyond, the ratio goes smoothly to 1."""
    (low, high), inf = lift.measured_z_hat, math.inf
    near, far = (float(r) for r in lift.ratio()(np.array([low, high])))
    z_hat = np.array([0, -3, -inf, math.nan, -math.nan, 2 * high, inf, 1e30])
    at = call(side, radius * z_hat)
    assert at[:, 3].tolist() == [-1, -1, -1, 2, 2, 1, 1, 1], where
    assert np.isfinite(at).all(), where
    assert at[:3, 0] == pytest.approx(near, rel=FLOAT)
    assert at[3:5, 0].tolist() == [1.0, 1.0]
    assert 0 <= (at[5, 0] - 1) / (far - 1) < 0.5
    assert at[6:, 0] == pytest.approx(1.0, rel=FLOAT)
    assert (at[:5, 1] == 0).all()
    # no step and no kink at the last station
    inner, outer = call(side, radius * high * np.array([1 - 1e-5, 1 + 1e-5]))
    assert (inner[3], outer[3]) == (0, 1)
    assert outer[0] == pytest.approx(inner[0], rel=FLOAT)
    assert outer[1] == pytest.approx(inner[1], rel=2e-3, abs=1e-9)


@needs_compiler
def test_standard_uncertainties_are_those_of_the_draws(job, named, tmp_path):
    call, _ = build(tmp_path, named, GCC, "-DNEARLIFT_DOUBLE", "-O1")
    for side in SIDES:
        lift = quoted.fitted_lift(job, side, controller.DRAWS)
        z_hat = np.geomspace(*lift.measured_z_hat, 41)[1:-1]
        at = call(side, job.campaign.vehicle.rotor_radius * z_hat)
        u = np.std(lift.drawn(z_hat), axis=0)
        assert at[:, 2] == pytest.approx(u, rel=0.06, abs=0.012 * u.max()), side


@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
def test_headers_of_two_campaigns_compile_in_one_file_and_call_no_library(
    named, tmp_path, compiler
):
    name, header = named
    text = header.read_text()
    other = text.replace(f"nearlift_{name}", "nearlift_other").replace(
        f"NEARLIFT_{name.upper()}", "NEARLIFT_OTHER"
    )
    (tmp_path / "one.h").write_text(text)
    (tmp_path / "other.h").write_text(other)
    calls = "".join(
        f"nearlift_lift {side}(nearlift_real z) {{ return nearlift_{campaign}_{side}(z); }}\n"
        for side, campaign in zip(SIDES, (name, "other", name), strict=True)
    )
    (tmp_path / "both.c").write_text(
        f'#include "one.h"\n#include "other.h"\n{calls}'
        "nearlift_real low(void) { return NEARLIFT_OTHER_CEILING_LOW_M; }\n"
    )
    flags = ("-O2", "-ffreestanding", "-c", "both.c")
    subprocess.run([compiler, *STRICT, *flags], cwd=tmp_path, check=True)
    symbols = subprocess.run(
        ["nm", "-u", "both.o"], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout
    assert set(symbols.split()) <= {"U", "_GLOBAL_OFFSET_TABLE_"}


def test_the_header_says_where_it_comes_from(job, named):
    text = named[1].read_text()
    assert tables.sha256(job.processed / TRIALS.file) in text
    assert "2020-09-13" in text
    assert re.search(r"K_b = \S+ \(90 %: \S+ to \S+\)", text)
    assert re.search(
        r"ceiling: .* with near_wall_saturation; valid for 0.12 <= z_hat <= 10.5", text
    )


# ---- what is exported


def other_model(job, name, parameters=(), tilt_rad=None):
    """Lift of the campaign with another base model at the ground, on another rig."""
    content = job.read_json(RESULTS)
    ground = content["boundaries"]["ground"]
    was = ground["coefficients"]["K_b"]
    ground |= {"base_model": name, "coefficients": dict.fromkeys(parameters, was)}
    job.write(RESULTS, content)
    if tilt_rad is not None:
        trials = job.read(TRIALS)
        job.write(TRIALS, trials | {"tilt_rad": np.resize(tilt_rad, len(trials["z_hat"]))})
    return quoted.fitted_lift(job, "ground", 2)


def test_what_a_model_needs_is_known_or_refused_and_never_taken_for_one(remake):
    rig = raw_manifest()["rig"] | {"edge": "10 mm", "gap": "92 mm"}
    at_edge = other_model(remake("ground", rig=rig), "images_edge")
    assert at_edge.arguments["edge_hat"] == pytest.approx(10 / 23)
    with pytest.raises(InputRefused, match=r"needs gap_hat: .* to one boundary"):
        other_model(remake("ground", rig=rig), "corridor", ("kappa",))
    tilted = other_model(remake("ground"), "images_tilted", tilt_rad=[0.05])
    assert tilted.arguments["tilt_rad"] == 0.05
    for angles in ([0.05, -0.05], None):
        job = remake("ground")
        with pytest.raises(InputRefused, match=r"needs tilt_rad: .* the same in all trials"):
            other_model(job, "images_tilted", tilt_rad=angles)


@pytest.mark.parametrize(
    ("base", "free"), [("sanchez_cuevas", ["K_b"]), ("hayden", [])], ids=["with K_b", "without"]
)
def test_an_effect_in_time_is_not_said_to_be_in_the_function(lifts, base, free):
    ground = lifts["ground"]
    known = {n: ground.arguments[n] for n in catalogue.model(base).needs}
    sagging = exported(
        replace(
            ground,
            model=compose(catalogue.model(base), catalogue.effect("supply_sag")),
            arguments={**known, "supply_V": 1.0, "supply_ref_V": 1.0},
            best={n: ground.best[n] for n in free} | {"sag_exponent": 2.0},
            intervals={n: ground.intervals[n] for n in free}
            | {"sag_exponent": Estimate(value=2.0, lo90=1.9, hi90=2.1)},
            draws={n: ground.draws[n] for n in free} | {"sag_exponent": np.array([1.9, 2.1])},
            effects=("supply_sag",),
        )
    )
    assert sagging["known"].keys() == known.keys()
    text = c_header(whole(sagging))
    assert "with supply_sag" not in text
    assert "sag_exponent" not in text
    assert "supply_sag was found too and is left out: it acts in time" in text
    assert sagging["model"] == base
    assert list(sagging["omitted"]) == ["supply_sag"]
    assert list(sagging["parameters"]) == list(sagging["covariance"]) == free
    assert bool(sagging["table"].u_ratio.any()) == bool(free)


def test_a_range_in_which_the_model_has_no_value_is_refused():
    model = catalogue.model("cheeseman_bennett_fixed")
    drawn = lambda z: model(z)[None]  # noqa: E731
    with pytest.raises(InputRefused, match=r"export: the model has no value at z_hat = 0.2"):
        lift_table(model, drawn, 0.1, 10.0)
    with pytest.raises(InputRefused, match=r"too steep near z_hat = 0.25"):
        lift_table(model, drawn, 0.2501, 10.0)


# ---- Python and JSON


def test_twice_gives_the_same_bytes(job):
    writers = (controller.write_c, controller.write_json, controller.write_python)
    before = [Path(write(job)).read_bytes() for write in writers]
    assert [Path(write(job)).read_bytes() for write in writers] == before


def test_the_python_module_is_the_model_and_needs_nothing_installed(job, lifts):
    path = controller.write_python(job)
    asked = {}
    for side, lift in lifts.items():
        inside = np.geomspace(*lift.measured_z_hat, 4001)[1:-1]
        asked[side] = [*inside, -1.0, math.nan, 2 * lift.measured_z_hat[1], math.inf]
    code = (
        "import json, runpy, sys; ratio = runpy.run_path(sys.argv[1])['ratio'];"
        "print(json.dumps({s: [ratio(s, z) for z in zs] for s, zs in json.load(sys.stdin).items()}))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code, path],
        input=json.dumps(asked),
        check=True,
        capture_output=True,
        text=True,
    )
    answers = json.loads(done.stdout)
    for side, lift in lifts.items():
        ratio, flag = np.array(answers[side]).T
        low, high = lift.ratio()(np.array(lift.measured_z_hat))
        beyond = 1 + (high - 1) / (2 + exported(lift)["table"].power)
        truth = [*lift.ratio()(np.array(asked[side][:-4])), low, 1.0, beyond, 1.0]
        assert ratio == pytest.approx(truth, rel=2e-7)
        assert flag.tolist() == [*[0] * (len(ratio) - 4), -1, 2, 1, 1]


def test_json_has_the_model_and_the_covariance_of_the_intervals(job, lifts):
    content = json.loads(Path(controller.write_json(job)).read_text())
    assert content["schema"] == "nearlift.lift_model/5"
    for side, lift in content["boundaries"].items():
        table = typed(LiftTable, lift["table"])
        z_hat = np.geomspace(table.low, table.high, 99)
        assert table(z_hat) == pytest.approx(lifts[side].ratio()(z_hat), rel=2e-7)
        assert list(lift["covariance"]) == list(lift["parameters"])
        matrix = np.array(list(lift["covariance"].values()))
        assert matrix == pytest.approx(matrix.T)
        for (name, p), variance in zip(lift["parameters"].items(), np.diag(matrix), strict=True):
            width = (p["hi90"] - p["lo90"]) / (2 * 1.6449)
            assert math.sqrt(variance) == pytest.approx(width, rel=0.08, abs=1e-12), name
