"""Empirical models of ground and ceiling: a form, and constants from data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.images import clear_of_boundary, gain


def hayden(z_hat: Any, /) -> Any:
    """Ground, one rotor: Hayden's correlation of helicopter flight tests.

        P / P_inf = 1 / (A + B (D/z)^2) at constant thrust,   A = 0.9926, B = 0.0379, D = 2 R
        L / L_inf = (A + B (2 / z_hat)^2)^(2/3)               at constant power

    Convention: z_hat is rotor plane to ground over rotor radius; the ratio is a thrust at constant
    power.

    Approximation: a regression, not a theory, and not an extension of the images; helicopters, one
    rotor, hover. Nothing is free.

    Traps: it does not tend to 1 far away but to A^(2/3) = 0.9951, so a free L_inf absorbs half a
    percent. The ratio crosses 1 near z_hat = 4.5. B multiplies the square of *diameter* over
    height.
    """
    return (0.9926 + 0.0379 * np.square(2.0 / clear_of_boundary(z_hat))) ** (2.0 / 3.0)


HAYDEN = LiftModel(
    "hayden", "Hayden",
    r"\frac{L}{L_\infty} = \left(0.9926 + 0.0379 \, (2 / \hat{z})^2\right)^{2/3}", hayden,
    boundary="ground", rotors="one", tends_to_one=False,
    source=Source(
        "Hayden, J. S., The Effect of the Ground on Helicopter Hovering Power Required, Proc. AHS"
        " 32nd Annual Forum, 1976",
        bibtex=("hayden1976",),
        doubts=(
            ("Read in a secondary transcription (code); the thesis that goes with it prints D/z"
             " inverted, taken as a misprint."),
            "B is transcribed as 0.0379 and as 0.03794.",
            ("Carter et al. say that Hayden 'later added power to the model'; it is an"
             " independent correlation."),
        ),
    ),
    checks=(
        Check(1.0, 1.094, tolerance=5e-4, quoted_by="own table of the formula"),
        Check(2.0, 1.0202, tolerance=5e-5, quoted_by="own table of the formula"),
        Check(3.0, 1.0063, tolerance=5e-5, quoted_by="own table of the formula"),
        Check(5.0, 0.9991, tolerance=5e-5, quoted_by="own table of the formula"),
    ),
)  # fmt: skip


def exponential(z_hat: Any, /, *, a: Any, b: Any) -> Any:
    """Ground: an exponential gain, the form without a pole.

        L / L_inf = 1 + a exp(-b z_hat)

    Convention: a > 0 gains lift; b > 0 is the decay per rotor radius. z_hat is rotor plane to
    ground over rotor radius.

    Approximation: empirical. It decays faster than any sum of images (which falls as 1 / z_hat^2),
    so it fits near stations well and far ones badly. It is finite at contact, where the images are
    not.

    Traps: published fits have a constant other than 1 (1.028 in a flight fit). It is an error of
    zero or of the lift far away. Here L_inf takes that part. Amplitude and decay are strongly
    correlated where no station lies below z_hat = 1 / b.
    """
    return 1.0 + a * np.exp(-b * np.asarray(z_hat, dtype=float))


EXPONENTIAL = LiftModel(
    "exponential", "Exponential", r"\frac{L}{L_\infty} = 1 + a \, e^{-b \hat{z}}", exponential,
    boundary="ground",
    parameters=(
        Parameter("a", "1", 0.383, (-1.0, 10.0), normal(0.4, 1.0),
            "relative lift gained if the form held down to contact"),
        Parameter("b", "1", 1.487, (0.05, 20.0),
            Prior(distribution="lognorm", shape=(1.0,), scale=1.5),
            "decay of the gain per rotor radius of height"),
    ),
    source=Source(
        "Form after Del Cont Bernard et al. 2017-18, He and Leang 2020 and Appius 2022; values"
        " fitted here to the coplanar pair of Garofano-Soldado et al.",
        doubts=(
            ("The default values are an own fit to open data of a rotor pair, R = 165 mm, with"
             " the lift far away left free. The data reject that fit (chi2 150 on 7)."),
            ("The form of Del Cont Bernard et al. is known from abstracts only; that of He and"
             " Leang, 1 / (1 - C_a exp(-C_b z_hat)), is from memory and not this one."),
        ),
    ),
    checks=(
        Check(1.0, 1.087, tolerance=1e-3,
            quoted_by="Garofano-Soldado et al., measured at z/R = 1 over z/R = 5"),
        Check(1.0, 1 + 0.114 * float(np.exp(-5.388 * 0.12)), {"a": 0.114, "b": 5.388 * 0.12},
            "Appius 2022, flight fit with R = 0.12 m, its constant 1.028 put at 1"),
    ),
)  # fmt: skip


CEILING_EXPONENTIAL = replace(
    EXPONENTIAL, name="ceiling_exponential", boundary="ceiling",
    parameters=(
        Parameter("a", "1", 0.85, (-1.0, 10.0), normal(0.85, 2.0),
            "relative lift gained if the form held to contact"),
        Parameter("b", "1", 3.8, (0.05, 30.0),
            Prior(distribution="lognorm", shape=(1.0,), scale=3.8),
            "decay of the gain per rotor radius of distance"),
    ),
    source=Source(
        "Form after Del Cont Bernard et al. 2017-18 (ground and ceiling); values set to pass"
        " through Hsiao and Chirarattananon's gamma",
        bibtex=("hsiao2019",),
        doubts=(
            ("The form is known from abstracts only; no published constants for a ceiling were"
             " seen."),
        ),
    ),
    checks=(
        Check(0.3, 1.273, tolerance=2e-3, quoted_by="gamma at z_hat = 0.3, own table"),
        Check(0.7, 1.060, tolerance=2e-3, quoted_by="gamma at z_hat = 0.7, own table"),
    ),
    notes="""\
Ceiling: an exponential gain.

    L / L_inf = 1 + a exp(-b z_hat)

Convention: a > 0 gains lift; b > 0 is the decay per rotor radius. z_hat is rotor plane to ceiling
over rotor radius.

Approximation: empirical; finite at contact, unlike gamma. Its default values pass through gamma at
z_hat = 0.3 and 0.7.

Traps: as the ground's `exponential`.
""",
)  # fmt: skip


AMPLITUDE = Parameter("a", "1", 0.0625, (-1.0, 5.0), normal(0.0625, 0.5),
    "relative lift gained at z_hat = 1")  # fmt: skip
POWER = Parameter("p", "1", 2.0, (0.1, 8.0),
    Prior(distribution="lognorm", shape=(0.75,), scale=2.0),
    "power with which the gain falls off with height")  # fmt: skip
_SIMULATOR = {"a": 11.36859 / 16, "p": 2.0}


def power_law(z_hat: Any, /, *, a: Any, p: Any) -> Any:
    """Ground: a power law of height.

        L / L_inf = 1 + a z_hat^(-p)

    Convention: a > 0 gains lift, p > 0. z_hat is rotor plane to ground over rotor radius.

    Approximation: empirical. p = 2 and a = 1/16 is Cheeseman and Bennett to first order. A
    quadrotor's images add up to a = 1/4 with p = 2 far away and less near by. A single power fits
    either range and not both. No pole above contact.

    Refusal: nan where z_hat is not positive.

    Traps: a and p are strongly correlated; a is the gain at z_hat = 1, even without stations there.
    The ground term of a widely used simulator is this form with p = 2 and a = 11.36859 / 16. That
    is some 3.5 times the gain that the paper measures.
    """
    return 1.0 + a * clear_of_boundary(z_hat) ** -p


POWER_LAW = LiftModel(
    "power_law", "Power law", r"\frac{L}{L_\infty} = 1 + a \, \hat{z}^{-p}", power_law,
    boundary="ground",
    parameters=(AMPLITUDE, POWER),
    source=Source(
        "Carter, Bouchard and Quinn 2021 ('power law dependencies between lift and ground"
        " proximity'); defaults: Cheeseman and Bennett to first order",
        bibtex=("carter2021", "cheeseman1955"),
        doubts=(
            "The paper states no power and no amplitude.",
            ("The simulator's coefficient 11.36859 (gym-pybullet-drones) is stated to be inspired"
             " by a published model. Its height is clipped, and a fork disables it for lack of"
             " data."),
        ),
    ),
    checks=(
        Check(2.0, 1.015625, quoted_by="1 + 1/64, Cheeseman and Bennett to first order"),
        Check(1.0, 1.71, _SIMULATOR, "gym-pybullet-drones' ground term", tolerance=1e-3),
        Check(2.0, 1.178, _SIMULATOR, "the same", tolerance=5e-4),
        Check(3.0, 1.079, _SIMULATOR, "the same", tolerance=5e-4),
    ),
)  # fmt: skip


CEILING_POWER_LAW = replace(
    POWER_LAW, name="ceiling_power_law", boundary="ceiling",
    parameters=(
        replace(AMPLITUDE, value=0.03125, bounds=(-1.0, 2.0), prior=normal(0.03125, 0.25)),
        replace(POWER, meaning="power with which the gain falls off with distance"),
    ),
    source=Source("Hsiao and Chirarattananon's gamma to first order far away (own expansion)",
        doi="10.1109/TMECH.2019.2929589", bibtex=("hsiao2019",),
        doubts=("Not published in this form.",)),
    checks=(
        Check(2.0, 1.008, tolerance=5e-4, quoted_by="gamma at z_hat = 2, own table"),
        Check(0.1, 1 + 0.5 * 0.125**0.5 / 0.1, {"a": 0.5 * 0.125**0.5, "p": 1.0},
            "gamma's limit near the ceiling less 1/2, own expansion"),
    ),
    notes="""\
Ceiling: a power law of distance.

    L / L_inf = 1 + a z_hat^(-p)

Convention: a > 0 gains lift, p > 0. z_hat is rotor plane to ceiling over rotor radius.

Approximation: empirical. gamma goes from p = 2, a = alpha / 4 far away to p = 1, a = sqrt(alpha) /
2 close to the ceiling. One power fits either range and not both.

Refusal: nan where z_hat is not positive.

Traps: those of the ground's `power_law`.
""",
)  # fmt: skip


def ceiling_empirical(z_hat: Any, /, *, c: Any, e: Any) -> Any:
    """Ceiling: the empirical form of Sanchez-Cuevas and Jimenez-Cano, both constants free.

        L / L_inf = 1 / (1 - c / (z_hat + e)^2)

    published with c = 1 / K_1 and e = K_2 / R.

    Convention: c > 0 gains lift. e > 0 moves the pole behind the ceiling, so that the lift stays
    finite at contact while sqrt(c) < e. z_hat is rotor plane to ceiling over rotor radius.

    Approximation: empirical, after the image of a ground; any number of rotors. The strength is c
    rather than K_1 because K_1 runs to infinity where there is no effect.

    Refusal: nan at and below the pole z_hat = sqrt(c) - e, and where z_hat is not positive.

    Traps: e is not distinguishable from a zero error of the distance.
    """
    # beyond the pole, where the shifted height is not positive, the square would come back finite
    return gain(c / np.square(clear_of_boundary(clear_of_boundary(z_hat) + e)))


CEILING_EMPIRICAL = LiftModel(
    "ceiling_empirical", "Empirical ceiling",
    r"\frac{L}{L_\infty} = \frac{1}{1 - c / (\hat{z} + e)^2}", ceiling_empirical,
    boundary="ceiling",
    parameters=(
        Parameter("c", "1", 0.04, (-0.5, 2.0), normal(0.04, 0.25),
            "strength, 1 / K_1; positive gains lift"),
        Parameter("e", "1", 0.25, (0.0, 2.0), Prior(distribution="expon", scale=0.5),
            "shift of the pole behind the ceiling in rotor radii, K_2 / R; at least sqrt(c)"
            " where lift is finite at contact"),
    ),
    source=Source(
        "Jimenez-Cano, A. E., Sanchez-Cuevas, P. J., et al., Contact-Based Bridge Inspection"
        " Multirotors, IEEE RA-L 4(4), 2019; Sanchez-Cuevas et al., ICUAS 2017",
        doi="10.1109/LRA.2019.2928206", bibtex=("jimenezcano2019",),
        doubts=(
            "The form is from memory and was not verified against the original.",
            ("K_1 and K_2 are unknown. The values here are not published. They start a fit in the"
             " middle of the range predicted by the theory of gamma."),
        ),
    ),
    checks=(
        Check(0.15, 4 / 3, quoted_by="own arithmetic: 1 / (1 - 0.04 / 0.16)"),
        Check(1.0, 1.333333, {"c": 0.25, "e": 0.0}, "own arithmetic: a bare image of strength 1/4"),
    ),
)  # fmt: skip


GROUND = (HAYDEN, EXPONENTIAL, POWER_LAW)
CEILING = (CEILING_EMPIRICAL, CEILING_EXPONENTIAL, CEILING_POWER_LAW)
