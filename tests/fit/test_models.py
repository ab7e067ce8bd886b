"""Declared errors that the trials cannot bear out are said to be too large."""

from __future__ import annotations

from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.fit.models import overdeclared
from nearlift.likelihood.budget import Component
from nearlift.results import Noise


def told(*parts: Component) -> list[str]:
    model = catalogue.model("sanchez_cuevas")
    return overdeclared(fit(model, campaign(0), parts, Noise(relative=0.004)))


def gain(standard: float, scope: str) -> Component:
    return Component(name="gain", on="gain", standard=standard, distribution="normal", scope=scope)


def test_what_is_declared_far_above_the_scatter_of_repeats_is_said_to_be() -> None:
    """20 % of each trial's own would show as 20 % of scatter; the same shared by the campaign would
    not, and is believed.
    """
    (said,) = told(gain(0.2, "trial"))
    assert "trials scatter far less than the stated uncertainties imply" in said
    assert told() == told(gain(0.2, "campaign")) == told(gain(1e-6, "trial")) == []
