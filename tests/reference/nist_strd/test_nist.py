"""Certified answers: every NIST StRD nonlinear data set, from both of NIST's starts, through the
optimiser that fits lift models.

A data set becomes a model with the parameters' declared starts and bounds, in a `Likelihood` whose
predictions are the curve itself (NIST's y is not a lift: no logarithm, no L_inf). `solve`,
`Likelihood.chi2`, `Likelihood.jacobian` and `parameter_covariance` are the library's own.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearlift.declare import Check, LiftModel, Parameter, Source, uniform
from nearlift.fit.information import parameter_covariance
from nearlift.fit.solver import FAR_DAMPING, minimise, refine, solve, system
from nearlift.likelihood.covariance import Covariance
from nearlift.likelihood.problem import Likelihood
from nearlift.results import Observations

HERE = Path(__file__).parent
DIGITS = 4
"""Of each parameter, at least; the log relative error that NIST calls LRE."""

HARD = (
    "Bennett5",
    "Lanczos1",
    "Lanczos2",
    "Lanczos3",
    "MGH09",
    "MGH10",
    "MGH17",
    "Misra1a",
    "Nelson",
)
"""Nearly singular or far off, where batched steps may give up and lmfit serves."""

exp, pi = np.exp, np.pi
CHWIRUT = lambda x, b1, b2, b3: exp(-b1 * x) / (b2 + b3 * x)  # noqa: E731
GAUSS = lambda x, b1, b2, b3, b4, b5, b6, b7, b8: (  # noqa: E731
    b1 * exp(-b2 * x) + b3 * exp(-((x - b4) ** 2) / b5**2) + b6 * exp(-((x - b7) ** 2) / b8**2)
)
CUBICS = lambda x, b1, b2, b3, b4, b5, b6, b7: (  # noqa: E731
    (b1 + b2 * x + b3 * x**2 + b4 * x**3) / (1 + b5 * x + b6 * x**2 + b7 * x**3)
)
LANCZOS = lambda x, b1, b2, b3, b4, b5, b6: (  # noqa: E731
    b1 * exp(-b2 * x) + b3 * exp(-b4 * x) + b5 * exp(-b6 * x)
)
CURVES: dict[str, Any] = {
    "Bennett5": lambda x, b1, b2, b3: b1 * (b2 + x) ** (-1 / b3),
    "BoxBOD": lambda x, b1, b2: b1 * (1 - exp(-b2 * x)),
    "Chwirut1": CHWIRUT,
    "Chwirut2": CHWIRUT,
    "DanWood": lambda x, b1, b2: b1 * x**b2,
    "ENSO": lambda x, b1, b2, b3, b4, b5, b6, b7, b8, b9: (
        b1
        + b2 * np.cos(2 * pi * x / 12)
        + b3 * np.sin(2 * pi * x / 12)
        + b5 * np.cos(2 * pi * x / b4)
        + b6 * np.sin(2 * pi * x / b4)
        + b8 * np.cos(2 * pi * x / b7)
        + b9 * np.sin(2 * pi * x / b7)
    ),
    "Eckerle4": lambda x, b1, b2, b3: b1 / b2 * exp(-0.5 * ((x - b3) / b2) ** 2),
    "Gauss1": GAUSS,
    "Gauss2": GAUSS,
    "Gauss3": GAUSS,
    "Hahn1": CUBICS,
    "Kirby2": lambda x, b1, b2, b3, b4, b5: (b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2),
    "Lanczos1": LANCZOS,
    "Lanczos2": LANCZOS,
    "Lanczos3": LANCZOS,
    "MGH09": lambda x, b1, b2, b3, b4: b1 * (x**2 + x * b2) / (x**2 + x * b3 + b4),
    "MGH10": lambda x, b1, b2, b3: b1 * exp(b2 / (x + b3)),
    "MGH17": lambda x, b1, b2, b3, b4, b5: b1 + b2 * exp(-x * b4) + b3 * exp(-x * b5),
    "Misra1a": lambda x, b1, b2: b1 * (1 - exp(-b2 * x)),
    "Misra1b": lambda x, b1, b2: b1 * (1 - (1 + b2 * x / 2) ** -2),
    "Misra1c": lambda x, b1, b2: b1 * (1 - (1 + 2 * b2 * x) ** -0.5),
    "Misra1d": lambda x, b1, b2: b1 * b2 * x / (1 + b2 * x),
    "Nelson": lambda x, b1, b2, b3: b1 - b2 * x[0] * exp(-b3 * x[1]),
    "Rat42": lambda x, b1, b2, b3: b1 / (1 + exp(b2 - b3 * x)),
    "Rat43": lambda x, b1, b2, b3, b4: b1 / (1 + exp(b2 - b3 * x)) ** (1 / b4),
    "Roszman1": lambda x, b1, b2, b3, b4: b1 - b2 * x - np.arctan(b3 / (x - b4)) / pi,
    "Thurber": CUBICS,
}
NO_SD = {
    "Lanczos1": (
        "exact to 11 digits by construction: its residuals, of 1e-13, are rounding, and so are"
        " deviations scaled by them"
    )
}


@dataclass(frozen=True)
class DataSet:
    name: str
    starts: np.ndarray
    certified: np.ndarray
    sd: np.ndarray
    rss: float
    x: np.ndarray
    y: np.ndarray


@functools.cache
def read(name: str) -> DataSet:
    lines = (HERE / f"{name}.dat").read_text().splitlines()
    number = r"\s+([-+.\dEe]+)"
    rows = [m for line in lines[40:58] if (m := re.match(rf"\s*b\d+ ={number * 4}\s*$", line))]
    table = np.array([[float(v) for v in m.groups()] for m in rows])
    rss = next(
        float(line.split(":")[1]) for line in lines if line.startswith("Residual Sum of Squares")
    )
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()]).T
    y = np.log(data[0]) if name == "Nelson" else data[0]
    return DataSet(
        name=name,
        starts=table[:, :2].T,
        certified=table[:, 2],
        sd=table[:, 3],
        rss=rss,
        x=data[1] if len(data) == 2 else data[1:],
        y=y,
    )


class Curve(Likelihood):
    """NIST's curve in the place of log lift: no logarithm, and no L_inf to eliminate."""

    def log_ratio(self, theta, offset_m=0.0):
        columns = {name: np.asarray(theta)[..., i, None] for i, name in enumerate(self.names)}
        with np.errstate(all="ignore"):
            return np.broadcast_to(
                self.model.evaluate(self.data.geometry["x"], **columns),
                (*np.shape(theta)[:-1], self.data.n),
            )

    def residuals(self, theta, offset_m=0.0):
        return self.data.lift_N - self.log_ratio(theta)

    def derivatives(self, theta, offset_m=0.0):
        return -self.slopes(theta)


def problem(given: DataSet, start: int) -> Curve:
    """Bounds ten times as wide as NIST's starts are large, either way: as little as a declaration
    can say.
    """
    names = [f"b{i}" for i in range(1, len(given.certified) + 1)]
    width = 10 * np.abs(given.starts).max(axis=0)
    scope: dict[str, Any] = {"curve": CURVES[given.name]}
    # declarations want keyword-only names
    text = f"lambda x, /, *, {', '.join(names)}: curve(x, {', '.join(names)})"
    evaluate = eval(text, scope)
    model = LiftModel(
        name=given.name.lower(),
        title=given.name,
        formula="see the data file",
        evaluate=evaluate,
        boundary="ground",
        parameters=tuple(
            Parameter(
                name=n, unit="1", value=v, bounds=(-w, w), prior=uniform(-w, w), meaning="NIST's"
            )
            for n, v, w in zip(names, given.starts[start], width, strict=True)
        ),
        source=Source("NIST StRD", doubts=("none",)),
        # a number that says nothing: what this model must reproduce is below
        checks=(Check(x=given.x[..., 0], expected=0.0, tolerance=np.inf),),
    )
    n = len(given.y)
    one = np.ones(n)
    data = Observations(
        boundary="ground",
        trial=np.arange(n).astype(str).astype(object),
        z_hat=one,
        lift_N=given.y,
        u_lift_N=0 * one,
        n_eff=one,
        throttle=one,
        visit=np.arange(n),
        session=np.zeros(n, dtype=np.int64),
        radius_m=1.0,
        geometry={"x": given.x},
    )
    return Curve(
        model=model,
        data=data,
        covariance=Covariance(
            variance=one, visit=np.arange(n), per_visit=0 * one, shared=np.zeros((n, 0))
        ),
    )


def digits(found: np.ndarray, certified: np.ndarray) -> float:
    """Of the worst."""
    return float(
        np.min(np.minimum(-np.log10(np.maximum(np.abs(found / certified - 1), 1e-16)), 11))
    )


@functools.cache
def solved(name: str, start: int) -> tuple[Curve, np.ndarray]:
    p = problem(read(name), start)
    with np.errstate(all="ignore"):
        return p, solve(p, quoted=True)[0]


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", CURVES)
def test_certified_parameters(name, start):
    given = read(name)
    p, theta = solved(name, start)
    assert digits(theta, given.certified) >= DIGITS
    assert float(p.chi2(theta)) == pytest.approx(
        given.rss, rel=1e-2 if name == "Lanczos1" else 1e-6
    )


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", CURVES)
def test_batched_steps_end_at_the_certified_parameters_or_say_that_they_do_not(name, start):
    p = problem(read(name), start)
    values = np.array([q.value for q in p.model.parameters])
    with np.errstate(all="ignore"):
        minima = minimise(
            system(p),
            values[None],
            p.model.bounds,
            np.abs(values),
            damping=FAR_DAMPING,
        )
        theta = refine(system(p), minima.theta, p.model.bounds)[0]
    assert minima.converged[0] or name in HARD
    if minima.converged[0]:
        assert digits(theta, read(name).certified) >= DIGITS


@pytest.mark.parametrize("name", [n for n in CURVES if n not in NO_SD])
def test_certified_standard_deviations(name):
    """From `Likelihood.jacobian` at the fit and `parameter_covariance`, times the residual variance: 3
    digits, where a fit quotes 2.
    """
    given = read(name)
    p, theta = solved(name, 1)
    covariance, determined = parameter_covariance(p.jacobian(theta).T)
    sd = np.sqrt(np.diag(covariance) * float(p.chi2(theta)) / (len(given.y) - len(theta)))
    assert determined.all()
    assert digits(sd, given.sd) >= 3


def test_every_data_set_is_here_and_whole():
    assert {path.stem for path in HERE.glob("*.dat")} == set(CURVES)
    for name in CURVES:
        given, text = read(name), (HERE / f"{name}.dat").read_text()
        assert len(given.y) == int(re.search(r"Number of Observations: +(\d+)", text)[1])
        assert len(given.certified) == int(re.search(r"(\d+) Parameters", text)[1])
        # the certified values and the transcribed curve give the certified sum of squares
        p = problem(given, 0)
        assert float(p.chi2(given.certified)) == pytest.approx(
            given.rss, rel=1e-6 if name != "Lanczos1" else 0.1
        )
