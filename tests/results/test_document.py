"""What is loaded is what was computed: types to JSON and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import pytest
from pydantic import Field
from tests.unit import verdicts

from nearlift.errors import ProductError
from nearlift.results import Estimate, Noise
from nearlift.results.diagnosis import DiagnosisResults
from nearlift.results.document import IfAny, NumberKey, Real, Unbounded, as_json, typed
from nearlift.results.fit import FitResults
from nearlift.results.quotation import Results
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    size: Unbounded
    condition: Annotated[str, Field(alias="if")]
    remark: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Only:
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    number: Real
    parts: Mapping[str, Part]
    levels: Mapping[NumberKey, Part | None]
    either: Part | Only | None


WHOLE = Whole(
    number=1.0,
    parts={"a": Part(size=math.inf, condition="so")},
    levels={0.25: None, 0.5: Part(size=2.0, condition="thus", remark="why")},
    either=Only(missing=("rpm",)),
)


def test_fields_are_keys_and_come_back():
    content = as_json(WHOLE)
    assert content == {
        "number": 1.0,
        "parts": {"a": {"size": None, "if": "so"}},
        "levels": {"0.25": None, "0.5": {"size": 2.0, "if": "thus", "remark": "why"}},
        "either": {"missing": ["rpm"]},
    }
    again = typed(Whole, content | {"of a later version": 1})
    assert again == WHOLE
    assert typed(Whole, content | {"either": None}).either is None


def test_null_is_what_its_type_says():
    e = typed(Estimate, dict.fromkeys(("value", "u", "lo90", "hi90")))
    assert math.isnan(e.value)
    assert (e.u, e.lo90, e.hi90) == (math.inf, -math.inf, math.inf)


def test_what_is_not_there_is_told_with_the_file():
    with pytest.raises(ProductError, match="size: Field required") as refusal:
        typed(Part, {"if": "so"}, "fit.json")
    assert refusal.value.where == "fit.json"
    with pytest.raises(ProductError, match="another version"):
        typed(Whole, {"number": "many", "parts": [], "levels": {}, "either": {}})


def test_noise_keeps_what_is_written_of_it():
    noise = Noise(relative=0.01, drift=(3.0, 4.0), source="repeats")
    assert as_json(noise)["drift"] == 5.0
    assert typed(Noise, as_json(noise)) == noise


@pytest.fixture(scope="module", params=verdicts.MADE.values(), ids=verdicts.MADE)
def job(request, make_job):
    return make_job(("ground",), diagnosed=True, **request.param)


PRODUCTS = [(FIT, FitResults), (RESULTS, Results), (DIAGNOSIS, DiagnosisResults)]


@pytest.mark.parametrize(("product", "kind"), PRODUCTS)
def test_a_product_is_its_type(job, product, kind):
    assert as_json(job.load(kind)) == job.read_json(product)
