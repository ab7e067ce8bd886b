"""An input of a model that is known with an uncertainty: its derivative against a refit, its part
of the budget, what is refused.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from tests.unit.manifests import raw_manifest
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.campaign import manifest
from nearlift.errors import ManifestError
from nearlift.fit import information, inputs
from nearlift.fit.least_squares import fit
from nearlift.fit.summary import summary
from nearlift.likelihood import budget
from nearlift.likelihood.budget import Component
from nearlift.report import sources, words
from nearlift.results import Noise
from nearlift.results.outlook import SilentEffect

MODEL = catalogue.model("sanchez_cuevas")
#: What `simulated.campaign` puts in.
SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)
ALL = ("spacing_hat", "diagonal_hat", "layout_hat")


def part(on, standard=0.01, scope="campaign", moves=ALL):
    return Component(
        name=on, on=on, standard=standard, distribution="normal", scope=scope, moves=moves
    )


def fitted(data, parts=()):
    return fit(MODEL, data, parts, SCATTER, offset_m=0.0)


def with_radius(data, factor):
    """The same trials at the same distances of a rig whose rotor is so many times as large."""
    hats = {name: value / factor for name, value in data.geometry.items() if name in ALL}
    return dataclasses.replace(
        data,
        z_hat=data.z_hat / factor,
        radius_m=data.radius_m * factor,
        geometry={**data.geometry, **hats},
    )


def with_spacing(data, factor, moves=ALL):
    hats = {name: value * factor for name, value in data.geometry.items() if name in moves}
    return dataclasses.replace(data, geometry={**data.geometry, **hats})


@pytest.mark.parametrize(
    ("on", "changed"),
    [
        ("rotor_radius", lambda data, h: with_radius(data, 1 + h)),
        ("rotor_spacing", lambda data, h: with_spacing(data, 1 + h)),
    ],
)
def test_a_geometry_moves_the_coefficient_as_a_refit_with_it_says(on, changed):
    data = campaign(3, visits=8)
    before = fitted(data)
    [acting] = inputs.acting([part(on, 1.0)], MODEL, before.theta)
    # a model that is too high by a derivative asks for a coefficient that is lower by its gain
    shift = before.gain @ acting.sensitivity(before.problem.data, before.slope)
    step = 1e-4
    refit = (fitted(changed(data, step)).theta - fitted(changed(data, -step)).theta) / (2 * step)
    # the gain is that of the fitted curve; what is left is the misfit's own curvature, of the
    # noise's relative size
    assert -shift == pytest.approx(refit, rel=0.02)


def test_a_diagonal_that_was_given_stays():
    data = campaign(3, visits=8)
    theta = np.array([2.0])
    [both] = inputs.acting([part("rotor_spacing")], MODEL, theta)
    [alone] = inputs.acting([part("rotor_spacing", moves=("spacing_hat",))], MODEL, theta)
    assert np.abs(both.derivative(data) - alone.derivative(data)).max() > 0.01


def test_an_input_widens_u_by_what_it_moves():
    data = campaign(3, visits=8)
    alone = fitted(data)
    wide = fitted(data, (part("rotor_radius", 0.01),))
    shift = alone.gain @ wide.parts[0].sensitivity(data, alone.slope)
    lines = information.lines(wide.problem, wide.gain, wide.parts, wide.noise, wide.slope)
    [line] = [a for a in lines if a.component == "rotor_radius"]
    # known exactly, what is left is the fit without it; declared, the fit may lean away from it,
    # but never below that
    jacobian = wide.problem.jacobian(wide.theta)
    u = information.u_without(wide.problem, jacobian, lines, np.sqrt(np.diag(wide.covariance)))
    assert u["rotor_radius"] == pytest.approx([alone.estimates["K_b"].u], rel=1e-3)
    assert (
        alone.estimates["K_b"].u
        < wide.estimates["K_b"].u
        <= np.hypot(alone.estimates["K_b"].u, abs(shift[0])) * 1.001
    )
    assert line.kind == "B"
    assert line.variance[0] > 0


def test_density_of_the_campaign_is_absorbed_and_of_a_session_is_not():
    data = campaign(3, visits=8)
    for scope, grows in (("campaign", False), ("session", True)):
        known, wide = fitted(data), fitted(data, (part("air_density", 0.02, scope),))
        assert (wide.estimates["K_b"].u > known.estimates["K_b"].u * 1.0001) == grows


def test_what_nobody_declared_is_listed_with_what_it_would_do():
    data = campaign(3, visits=8)
    listed = {u.on: u for u in summary(fitted(data)).undeclared}
    assert set(listed) == {"rotor_radius", "rotor_spacing", "height"}
    one = fitted(data, (part("rotor_radius"),))
    assert {u.on for u in summary(one).undeclared} == {"rotor_spacing", "height"}
    radius, spacing, height = (
        abs(listed[on].shift["K_b"]) for on in ("rotor_radius", "rotor_spacing", "height")
    )

    def known(u, *inputs, found=None):
        entry = SimpleNamespace(undeclared=tuple(listed[on] for on in inputs))
        every = {"K_b": SimpleNamespace(u=u)}
        quoted = SimpleNamespace(headline="K_b", coefficients=every)
        return SimpleNamespace(
            quoted=lambda _: quoted, base=lambda _: (None, entry), diagnosed=lambda _: found
        )

    both = known(radius / 4.4, "rotor_spacing", "rotor_radius")
    assert [(e.in_u, e.on) for e in sources.undeclared(both, "ground")] == [
        (pytest.approx(4.4), "rotor_radius"),
        (pytest.approx(4.4 * spacing / radius), "rotor_spacing"),
    ]
    own = words.Brief(both, "ground").inputs
    assert own.startswith(
        f"A 1 % error in rotor radius shifts K_b by {radius:.2g}, in rotor spacing by"
    )
    assert own.endswith(". The manifest states neither.")
    assert words.Brief(known(10 * radius, "rotor_radius"), "ground").inputs == ""

    # an offset that the diagnosis would have seen is not held against the number
    u = height / 40

    def diagnosed(verdict, **hidden):
        silent = SilentEffect(
            effect="height_offset",
            absorbed_by="K_b",
            share_visible=0.1,
            u=u,
            **{"bias_at_detection_limit": 0.0, "hidden": False} | hidden,
        )
        return SimpleNamespace(verdict=verdict, untestable={}, silent=(silent,) if hidden else ())

    def worst(found):
        [error] = sources.undeclared(known(u, "height", found=found), "ground")
        return error.size / listed["height"].size, error.in_u, error.at_most

    limit = {"bias_at_detection_limit": 10.0, "hidden": False}
    assert worst(diagnosed("adequate", **limit)) == pytest.approx((0.25, 10, True))
    assert worst(diagnosed("adequate")) == pytest.approx((1 / 40, 1, True))
    for unlimited in (
        diagnosed("unexplained", **limit),
        diagnosed("adequate", **limit | {"hidden": True}),
        None,
    ):
        assert worst(unlimited) == pytest.approx((1, 40, False))
    # 0.12 of a millimetre, and not 0.125, which the last digit of u would round
    limit["bias_at_detection_limit"] = 9.6
    seen = known(u, "height", found=diagnosed("adequate", **limit))
    own = words.Brief(seen, "ground").inputs
    assert own.startswith("A 0.12 mm error in distance datum shifts K_b by up to")


def parsed(**line):
    declared = {
        "name": "blade",
        "on": "rotor_radius",
        "value": "0.23 mm",
        "scope": "campaign",
    } | line
    return manifest.parse(raw_manifest(uncertainty=[declared]))


def test_a_length_and_a_part_of_it_are_the_same():
    for value in ("0.23 mm", "1 percent", "0.01 fraction"):
        assert budget.components(parsed(value=value))[0].standard == pytest.approx(0.01)
    assert budget.components(parsed(on="exponent", value="0.1 fraction"))[0].standard == 0.1
    assert budget.components(parsed(on="rotor_spacing", value="0.65 mm"))[0].moves == (
        "spacing_hat",
        "diagonal_hat",
        "layout_hat",
    )


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ({"value": "0.2 N"}, "is not a unit of length"),
        (
            {"on": "air_density", "value": "0.01 kg/m^3"},
            (
                "is on the air_density, which is not given: give it, or state the uncertainty in"
                " percent"
            ),
        ),
        ({"on": "blade"}, "rotor_radius"),
    ],
)
def test_what_cannot_be_is_refused(line, text):
    with pytest.raises(ManifestError, match=text):
        parsed(**line)
