"""Exported models: the compiled C, the Python module, JSON and CasADi agree with the model over the
whole range.
"""

from __future__ import annotations

import ctypes
import importlib.util
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

from nearlift import catalogue
from nearlift.declare import compose
from nearlift.errors import InputRefused
from nearlift.flight.export import closed_form as closed
from nearlift.flight.export import json_document
from nearlift.flight.export.hermite import hermite_table
from nearlift.flight.export.model_export import ModelExport, exported
from nearlift.products import DIAGNOSIS, TRIALS
from nearlift.stages import export as controller
from nearlift.stages.quoted_lift import fitted_lift

from . import quoted

SIDES = ("ground", "ceiling", "sidewall")
GCC = shutil.which("gcc") or shutil.which("cc")
needs_compiler = pytest.mark.skipif(GCC is None, reason="no C compiler on this machine")
#: A float carries 6e-8; the table is within 1.5e-7 of the model, and either form takes some ten
#: roundings.
FLOAT = 1e-6


@pytest.fixture(scope="module")
def job(remake):
    """A fitted campaign whose ceiling saturates, as the loop would say."""
    job = remake()
    (job.root / "campaign.toml").write_text("")
    os.utime(job.root / "campaign.toml", (1.6e9, 1.6e9))
    span = {"value": 0.02, "lo90": 0.01, "hi90": 0.03}
    effect = {
        "name": "near_wall_saturation",
        "parameters": {
            "gap_hat2": span,
            "saturation_power": {"value": 0.68, "lo90": 0.68, "hi90": 0.68},
        },
    }
    found = {
        "verdict": "effect",
        "effects": [effect],
        "coefficients": {"after": {"alpha": {"value": 0.1, "lo90": 0.09, "hi90": 0.11}}},
    }
    job.write_json(DIAGNOSIS, quoted.diagnosis({"ceiling": found}))
    quoted.write(job, {"ceiling": found})
    return job


@pytest.fixture(scope="module")
def beliefs(job):
    return {side: fitted_lift(job, side, 2) for side in SIDES}


def heights(belief):
    return np.geomspace(*belief.measured_z_hat, 4001)


# ---- C


class Found(ctypes.Structure):
    _fields_ = (("ratio", ctypes.c_float), ("flag", ctypes.c_int))


SOURCE = """
#include "lift_model.h"
#define EXPORT(name) nearlift_ratio call_##name(float z) { return nearlift_##name(z); }
EXPORT(ground) EXPORT(ceiling) EXPORT(sidewall)
#ifdef NEARLIFT_CLOSED_FORM
EXPORT(ground_closed) EXPORT(ceiling_closed) EXPORT(sidewall_closed)
#endif
"""
STRICT = (
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wdouble-promotion",
    "-Wfloat-conversion",
    "-Wno-unused-function",
    "-O2",
)


@pytest.fixture(
    scope="module", params=[(), ("-ffast-math", "-Wno-div-by-zero")], ids=["strict", "fast-math"]
)
def library(request, job, tmp_path_factory):
    """With -ffast-math too, under which no comparison sees a NaN."""
    folder = tmp_path_factory.mktemp("c")
    shutil.copy(controller.write_c(job), folder)
    (folder / "calls.c").write_text(SOURCE)
    compiled = [GCC, *STRICT, *request.param, "-DNEARLIFT_CLOSED_FORM", "-fPIC", "-c", "calls.c"]
    subprocess.run(compiled, cwd=folder, check=True)
    # linked without -ffast-math, whose start-up code would flush this process's subnormals to zero
    command = [GCC, "-shared", "-o", "calls.so", "calls.o", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return ctypes.CDLL(str(folder / "calls.so"))


@needs_compiler
@pytest.mark.parametrize("form", ["", "_closed"])
@pytest.mark.parametrize("side", SIDES)
def test_the_compiled_header_is_the_model_to_float_precision(library, beliefs, side, form):
    call = getattr(library, f"call_{side}{form}")
    call.restype, call.argtypes = Found, (ctypes.c_float,)
    z_hat = heights(beliefs[side]).astype(np.float32)[1:-1]
    found = [call(float(z)) for z in z_hat]
    assert {f.flag for f in found} == {0}
    # the model at the very float that C was given
    truth = beliefs[side].ratio()(z_hat.astype(float))
    assert np.max(np.abs(np.array([f.ratio for f in found]) / truth - 1)) < FLOAT


@needs_compiler
@pytest.mark.parametrize("form", ["", "_closed"])
def test_outside_its_validity_c_clamps_and_flags(library, beliefs, form):
    call = getattr(library, f"call_ceiling{form}")
    call.restype, call.argtypes = Found, (ctypes.c_float,)
    far = beliefs["ceiling"].measured_z_hat[1]
    low, high = (
        float(r) for r in beliefs["ceiling"].ratio()(np.array(beliefs["ceiling"].measured_z_hat))
    )
    for z, flag, ratio in (
        (0.0, -1, low),
        (-3.0, -1, low),
        (math.nan, 2, 1.0),
        (-math.inf, -1, low),
        (2 * far, 1, 1 + (high - 1) / 4),
        (math.inf, 1, 1.0),
    ):
        found = call(z)
        assert found.flag == flag
        assert found.ratio == pytest.approx(ratio, rel=FLOAT)


@needs_compiler
def test_headers_of_two_campaigns_stand_in_one_file(job, tmp_path):
    text = Path(controller.write_c(job)).read_text()
    name = re.search(r"nearlift_ratio nearlift_(\w+)_ground\(", text)[1]
    other = text.replace(f"nearlift_{name}", "nearlift_other").replace(
        f"NEARLIFT_{name.upper()}", "NEARLIFT_OTHER"
    )
    (tmp_path / "one.h").write_text(text)
    (tmp_path / "other.h").write_text(other)
    calls = f"float f(float z) {{ return nearlift_{name}_ground(z).ratio + nearlift_other_ceiling(z).ratio; }}"
    (tmp_path / "both.c").write_text(f'#include "one.h"\n#include "other.h"\n{calls}\n')
    build = [GCC, *STRICT, "-c", "both.c"]
    subprocess.run([*build, "-DNEARLIFT_LONG_NAMES"], cwd=tmp_path, check=True, capture_output=True)
    refused = subprocess.run(build, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert refused.returncode
    assert "two lift models: define NEARLIFT_LONG_NAMES" in refused.stderr


@needs_compiler
def test_the_table_form_calls_no_library(job, tmp_path):
    shutil.copy(controller.write_c(job), tmp_path)
    (tmp_path / "calls.c").write_text(SOURCE)
    subprocess.run(
        [GCC, *STRICT, "-ffreestanding", "-c", "calls.c"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
    )
    undefined = subprocess.run(
        ["nm", "-u", "calls.o"], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout
    assert [name for name in undefined.split() if name not in ("U", "_GLOBAL_OFFSET_TABLE_")] == []
    text = (tmp_path / "lift_model.h").read_text()
    assert not re.search(r"\bdouble\b|\bmalloc\b", text)


def test_the_header_says_where_it_comes_from(job):
    from nearlift.run import store

    text = Path(controller.write_c(job)).read_text()
    assert store.sha256(job.processed / TRIALS.file) in text
    assert "2020-09-13" in text
    assert re.search(r"K_b = \S+ \(90 %: \S+ to \S+\)", text)
    assert re.search(
        r"ceiling: .* with near_wall_saturation; valid for 0.12 <= z_hat <= 10.5", text
    )
    assert re.search(r"at z_hat = \S+: \S+ \(90 %: \S+ to \S+\)", text)


def test_an_effect_in_time_is_not_said_to_be_in_the_function(beliefs):
    sagging = exported(replace(beliefs["ground"], effects=("supply_sag",)))
    made = ModelExport(
        campaign="c",
        nearlift="0",
        digest="0",
        date="unknown",
        source="results.json",
        radius_m=0.023,
        held="throttle",
        lifts=(sagging,),
    )
    about = "\n".join(made.about())
    assert "with supply_sag" not in about
    assert "supply_sag acts in time and not on this ratio" in about


def test_twice_gives_the_same_bytes(job):
    writers = (
        controller.write_c,
        controller.write_json,
        controller.write_python,
        controller.write_casadi,
    )
    before = [Path(write(job)).read_bytes() for write in writers]
    assert [Path(write(job)).read_bytes() for write in writers] == before


# ---- Python and CasADi


def module_of(path):
    spec = importlib.util.spec_from_file_location("lift_model", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("side", SIDES)
def test_the_python_module_is_the_model(job, beliefs, side):
    module = module_of(controller.write_python(job))
    z_hat = heights(beliefs[side])[1:-1]
    truth = beliefs[side].ratio()(z_hat)
    assert [module.ratio(side, z)[0] for z in z_hat] == pytest.approx(truth, rel=2e-7)
    assert [module.closed(side, z)[0] for z in z_hat] == pytest.approx(truth, rel=1e-12)
    assert module.ratio(side, z_hat[9])[1] == 0
    low, high = (float(v) for v in beliefs[side].ratio()(np.array(beliefs[side].measured_z_hat)))
    far = beliefs[side].measured_z_hat[1]
    beyond = (2 * far, 1, 1 + (high - 1) / 4)
    for z, flag, ratio in ((-1.0, -1, low), (math.nan, 2, 1.0), beyond, (math.inf, 1, 1.0)):
        for form in (module.ratio, module.closed):
            assert form(side, z) == (pytest.approx(ratio, rel=2e-7), flag)


def test_the_python_module_runs_without_anything_installed(job):
    code = (
        f"import runpy; m = runpy.run_path({controller.write_python(job)!r});"
        " print(m['ratio']('ground', 1.5)[1])"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], check=True, capture_output=True, text=True
    )
    assert done.stdout == "0\n"


@pytest.mark.parametrize("side", SIDES)
def test_the_casadi_expression_is_the_model(job, beliefs, side):
    casadi = pytest.importorskip("casadi", reason="casadi is not installed")
    module = module_of(controller.write_casadi(job))
    z = casadi.SX.sym("z")
    ratio = casadi.Function("ratio", [z], [module.ratio(side, z)])
    slope = casadi.Function("slope", [z], [casadi.jacobian(module.ratio(side, z), z)])
    z_hat = heights(beliefs[side])[1:-1]
    truth = beliefs[side].ratio()(z_hat)
    assert np.array(ratio(z_hat)).ravel() == pytest.approx(truth, rel=1e-12)
    step = 1e-5 * z_hat
    numeric = (beliefs[side].ratio()(z_hat + step) - beliefs[side].ratio()(z_hat - step)) / (
        2 * step
    )
    inner = slice(5, -5)
    assert np.array(slope(z_hat)).ravel()[inner] == pytest.approx(
        numeric[inner], rel=1e-4, abs=1e-8
    )


# ---- JSON


def follows(value, schema, where="$"):
    """The part of JSON Schema that the schema uses."""
    kinds = {
        "object": dict,
        "array": list,
        "string": str,
        "number": (int, float),
        "null": type(None),
    }
    if "type" in schema:
        wanted = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        assert isinstance(value, tuple(k for w in wanted for k in np.atleast_1d(kinds[w]))), where
    if "const" in schema:
        assert value == schema["const"], where
    if "enum" in schema:
        assert value in schema["enum"], where
    if "pattern" in schema:
        assert re.search(schema["pattern"], value), where
    for name in schema.get("required", ()):
        assert name in value, f"{where}.{name}"
    if isinstance(value, dict):
        for name, inner in value.items():
            own = schema.get("properties", {}).get(name, schema.get("additionalProperties"))
            if own:
                follows(inner, own, f"{where}.{name}")
    if isinstance(value, list):
        assert len(value) >= schema.get("minItems", 0)
        for i, inner in enumerate(value):
            follows(inner, schema.get("items", {}), f"{where}[{i}]")


def test_json_follows_its_schema_and_its_table_is_the_model(job, beliefs):
    path = controller.write_json(job)
    content = json.loads(Path(path).read_text())
    schema = json.loads(Path(path.replace(".json", ".schema.json")).read_text())
    assert schema == json_document.SCHEMA
    follows(content, schema)
    with pytest.raises(AssertionError, match=r"\$.boundaries"):
        follows({k: v for k, v in content.items() if k != "boundaries"}, schema)
    own = content["boundaries"]["ground"]
    table = own["table"]
    assert len(table["value"]) == len(table["slope"])
    assert table["value"][-1] == pytest.approx(
        float(beliefs["ground"].ratio()(np.array([own["valid_z_hat"][0]]))[0])
    )
    assert own["closed_form"].count("(") == own["closed_form"].count(")")


# ---- closed forms


@pytest.mark.parametrize(
    "model", [m for m in catalogue.models() if m.closed_form], ids=lambda m: m.name
)
def test_every_closed_form_is_its_declaration(model):
    known = {n: {"spacing_hat": 65 / 23, "diagonal_hat": 4.0}[n] for n in model.needs}
    values = {p.name: p.value * 1.1 for p in model.parameters}
    z_hat = np.geomspace(0.6, 12, 500)
    form = closed.fold(closed.closed_form(model), {**known, **values})
    assert closed.evaluate(form, z_hat) == pytest.approx(model(z_hat, **known, **values), rel=1e-12)


@pytest.mark.parametrize(
    "effect",
    # the supply's fall is in time: at its reference it changes nothing
    [e for e in catalogue.effects() if e.closed_form not in ("", "r")],
    ids=lambda e: e.name,
)
def test_every_effect_s_closed_form_is_its_declaration(effect):
    base = catalogue.model("sanchez_cuevas")
    whole = compose(base, effect)
    known = {n: {"spacing_hat": 65 / 23, "diagonal_hat": 4.0}[n] for n in whole.needs}
    values = {p.name: p.value + 0.1 * (p.bounds[1] - p.value) for p in whole.parameters}
    z_hat = np.geomspace(1.0, 12, 500)
    form = closed.fold(closed.closed_form(whole), {**known, **values})
    assert closed.evaluate(form, z_hat) == pytest.approx(whole(z_hat, **known, **values), rel=1e-12)


def test_every_flying_effect_has_a_closed_form_or_is_exported_as_a_table():
    assert closed.closed_form(catalogue.model("images")) is None
    without = compose(catalogue.model("sanchez_cuevas"), catalogue.effect("fountain_shape"))
    assert closed.closed_form(without) is None


def test_a_range_in_which_the_model_has_no_value_is_refused():
    model = catalogue.model("cheeseman_bennett_fixed")
    with pytest.raises(InputRefused, match=r"export: the model has no value at z_hat = 0.2"):
        hermite_table(lambda z: model(z), 0.1, 10.0)
    with pytest.raises(InputRefused, match=r"too steep near z_hat = 0.25"):
        hermite_table(lambda z: model(z), 0.2501, 10.0)
