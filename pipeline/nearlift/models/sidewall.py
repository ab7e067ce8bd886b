"""Models of a sidewall: lift lost as the blade tip nears a wall."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.images import clear_of_boundary


def sidewall_decay(z_hat: Any, /, *, a: Any, lambda_: Any) -> Any:
    """Sidewall: lift lost, decaying exponentially with the gap.

        L / L_inf = 1 - a exp(-z_hat / lambda_)

    Convention: z_hat is the gap between the wall and the nearest blade *tip* over rotor radius.
    From the rotor axis it would be larger by 1. a > 0 loses lift, and is the loss of the whole
    vehicle at contact; lambda_ > 0 in rotor radii.

    Approximation: empirical. No verified closed form of a sidewall's effect exists. Potential
    images predict none at first order (`sidewall_none`), so the loss comes from wake, entrainment
    or recirculation.

    Traps: a absorbs a zero error of the distance exactly (a exp(-dz / lambda_)). With a near 0,
    lambda_ is not identifiable.
    """
    return 1.0 - a * np.exp(-np.asarray(z_hat, dtype=float) / lambda_)


SIDEWALL_DECAY = LiftModel(
    "sidewall_decay", "Exponential decay", r"\frac{L}{L_\infty} = 1 - a \, e^{-\hat{z} / \lambda}",
    sidewall_decay, boundary="sidewall",
    parameters=(
        Parameter("a", "1", 0.05, (-0.5, 0.9), normal(0.05, 0.15),
            "relative lift lost with the blade tip at the wall; negative would be a gain"),
        Parameter("lambda_", "1", 0.33, (0.02, 10.0),
            Prior(distribution="lognorm", shape=(1.0,), scale=0.33),
            "gap, in rotor radii, over which the loss falls to 1/e"),
    ),
    source=Source(
        "Form common to wall-effect studies; values from two statements of Carter, Bouchard and"
        " Quinn 2021",
        bibtex=("carter2021",),
        doubts=(
            ("The paper fits no sidewall model. a and lambda_ follow from 'less than 5 %', read"
             " as 5 % at contact, and from '|dL| > 2 % for z_hat < 0.3'."),
            ("The paper measures from 'the rotor nearest to the wall'; z_hat < 0.3 can only be"
             " the gap at the blade tip."),
            ("One reading of the load cell is good to 1.5 gf, more than the whole effect at every"
             " throttle."),
        ),
    ),
    checks=(
        Check(0.3, 0.98, tolerance=5e-4, quoted_by="Carter et al.: 2 % at z_hat = 0.3"),
        Check(0.0, 0.95, quoted_by="Carter et al.: less than 5 %"),
    ),
)  # fmt: skip


def sidewall_power_law(z_hat: Any, /, *, a: Any, p: Any) -> Any:
    """Sidewall: lift lost, falling off as a power of the distance between wall and rotor axis.

        L / L_inf = 1 - a (1 + z_hat)^(-p)

    Convention: z_hat is the gap between the wall and the nearest blade tip over rotor radius. The
    distance of the rotor axis is 1 + z_hat. a > 0 loses lift, and is the loss at contact; p > 0.

    Approximation: empirical, the rival of `sidewall_decay` with a longer reach; finite at contact.

    Traps: a and p are strongly correlated where the stations do not go beyond one radius.
    """
    return 1.0 - a * clear_of_boundary(1.0 + z_hat) ** -p


SIDEWALL_POWER_LAW = LiftModel(
    "sidewall_power_law", "Power law", r"\frac{L}{L_\infty} = 1 - a \, (1 + \hat{z})^{-p}",
    sidewall_power_law, boundary="sidewall",
    parameters=(
        Parameter("a", "1", 0.05, (-0.5, 0.9), normal(0.05, 0.15),
            "relative lift lost with the blade tip at the wall"),
        Parameter("p", "1", 3.5, (0.1, 20.0),
            Prior(distribution="lognorm", shape=(1.0,), scale=3.5),
            "power with which the loss falls off with the axis' distance"),
    ),
    source=Source("Own rival form; values from two statements of Carter, Bouchard and Quinn 2021",
        bibtex=("carter2021",),
        doubts=("Not published; it is here to ask whether the data insist on an exponential.",)),
    checks=(
        Check(0.3, 0.98, tolerance=5e-4, quoted_by="Carter et al.: 2 % at z_hat = 0.3"),
        Check(0.0, 0.95, quoted_by="Carter et al.: less than 5 %"),
    ),
)  # fmt: skip


def sidewall_none(z_hat: Any, /) -> Any:
    """Sidewall: no change of lift, as the images predict.

        L / L_inf = 1

    The image of a rotor in a wall is at the same height. A source there moves no air along the
    rotor's axis, so at first order lift does not change. A sidewall model that cannot beat this one
    has found nothing.

    Convention: z_hat is the gap between the wall and the nearest blade tip over rotor radius.

    Approximation: potential flow. Wake, entrainment and recirculation are left out; a measured loss
    must come from them.
    """
    return np.ones_like(np.asarray(z_hat, dtype=float))


SIDEWALL_NONE = LiftModel(
    "sidewall_none", "No change", r"\frac{L}{L_\infty} = 1", sidewall_none, boundary="sidewall",
    source=Source("Own derivation from the image source of Cheeseman and Bennett",
        bibtex=("cheeseman1955",), doubts=("First order only.",)),
    checks=(Check(0.3, 1.0, tolerance=0.0, quoted_by="own derivation"),),
)  # fmt: skip


MODELS = (SIDEWALL_DECAY, SIDEWALL_POWER_LAW, SIDEWALL_NONE)
