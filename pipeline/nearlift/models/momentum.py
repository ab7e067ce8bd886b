"""Models of momentum theory: radial inflow between a ceiling and the disk."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Source, normal, variant
from nearlift.models.images import clear_of_boundary


def gamma(z_hat: Any, alpha: Any) -> Any:
    """Power far away over power near the ceiling, at the same thrust; >= 1 for alpha >= 0."""
    radicand = 1.0 + alpha / np.square(clear_of_boundary(z_hat))
    return 0.5 + 0.5 * np.sqrt(np.where(radicand >= 0, radicand, np.nan))


def hsiao_chirarattananon(z_hat: Any, /, *, alpha: Any) -> Any:
    """Ceiling: Hsiao and Chirarattananon's gamma with a free coefficient, as the paper uses it.

        L / L_inf = gamma = 1/2 + 1/2 sqrt(1 + alpha / z_hat^2)

    Convention: z_hat is rotor plane to ceiling over rotor radius; alpha > 0 gains lift, alpha = 1/8
    is the plain theory.

    Approximation: radial inflow between ceiling and disk, uniform through the disk; inviscid,
    incompressible; blade-element momentum theory and one control volume. Each rotor by itself: no
    rotor-rotor term, so one rotor or several.

    What is held: gamma is the ratio of *powers* at the same thrust, P_inf / P. As a ratio of
    thrusts it is right to the power 2/3 at constant power, and to a falling power below 0.8 at
    constant rpm. The paper and others use the power 1, the default here;
    `hsiao_chirarattananon_constant_power` and `_free_exponent` are its rivals. A power of 1
    overpredicts close to the ceiling, which the paper attributes to viscosity. alpha, n, the zero
    of the distance and a viscous gap are nearly confounded.

    Refusal: nan where z_hat is not positive, or alpha so negative that the root has no value.

    Traps: the coefficient is often written alpha_0 / 8; here alpha = alpha_0 / 8. A further factor
    alpha_1 (recirculation) is left out.
    """
    return gamma(z_hat, alpha)


def hsiao_chirarattananon_downwash(z_hat: Any, /, *, alpha: Any) -> Any:
    """Induced velocity at the disk over its value far away, at the same thrust: 1 / gamma."""
    return 1.0 / gamma(z_hat, alpha)


ALPHA = Parameter("alpha", "1", 0.125, (0.0, 4.0), normal(0.125, 0.25),
    "strength of the ceiling's effect on the inflow; positive gains lift, 0.125 is the theory, 0"
    " no effect")  # fmt: skip


HSIAO_CHIRARATTANANON = LiftModel(
    "hsiao_chirarattananon", "Hsiao-Chirarattananon",
    r"\frac{L}{L_\infty} = \frac{1}{2} + \frac{1}{2} \sqrt{1 + \alpha / \hat{z}^2}",
    hsiao_chirarattananon, boundary="ceiling", downwash=hsiao_chirarattananon_downwash,
    parameters=(ALPHA,),
    source=Source(
        "Hsiao, Y. H., and Chirarattananon, P., Ceiling Effects for Hybrid Aerial-Surface"
        " Locomotion of Small Rotorcraft, IEEE/ASME Trans. Mechatronics, 2019",
        equation="(6), (7), (10) as transcribed; Eq. 3 of Carter, Bouchard and Quinn 2021",
        doi="10.1109/TMECH.2019.2929589", bibtex=("hsiao2019",),
        doubts=(
            ("Read in a transcription that cites the equations by number; the function and its"
             " meaning as a power ratio were derived again independently."),
            ("Fitted alpha_0 up to 1.60 (alpha 0.20) for a single 23 mm propeller; the full tables"
             " of alpha_0 and alpha_1 were not seen."),
            ("Carter et al. call this the first near-ceiling model; Rossow 1985 (NASA TM-86754) is"
             " earlier."),
            ("The authors' own measurements are said to fall below the theory closer than half a"
             " radius."),
        ),
    ),
    checks=(
        Check(0.5, 1.112372, quoted_by="golden value, exact from the formula"),
        Check(1.0, 1.030330, quoted_by="golden value, exact from the formula"),
        Check(2.0, 1.007752, quoted_by="golden value, exact from the formula"),
        Check(0.1, 2.337117, quoted_by="golden value, exact from the formula"),
    ),
)  # fmt: skip


HSIAO_CHIRARATTANANON_CONSTANT_POWER = variant(
    HSIAO_CHIRARATTANANON, exponent=2.0 / 3.0, name="hsiao_chirarattananon_constant_power",
    title="Hsiao-Chirarattananon, constant power",
    formula=(
        r"\frac{L}{L_\infty} = \left(\frac{1}{2} + \frac{1}{2} \sqrt{1 + \alpha /"
        r" \hat{z}^2}\right)^{2/3}"
    ),
    checks=(
        Check(0.1, 1.761, tolerance=5e-4, quoted_by="own table of gamma^(2/3)"),
        Check(0.5, 1.074, tolerance=5e-4, quoted_by="the same table"),
        Check(1.0, 1.020, tolerance=5e-4, quoted_by="the same table"),
    ),
    notes="""\
Ceiling: Hsiao and Chirarattananon's gamma as a thrust at constant power.

    L / L_inf = gamma^(2/3),   gamma = 1/2 + 1/2 sqrt(1 + alpha / z_hat^2)

Convention: as `hsiao_chirarattananon`. gamma is P_inf / P at the same thrust; thrust grows as power
to the 2/3.

Approximation: all power is induced power. The ratio is the consistent one for a rig that holds
power.

Refusal: nan where z_hat is not positive.

Traps: alpha fitted here is not alpha fitted with the power 1; far away alpha_here = 1.5 alpha_there
fits the same data.
""",
)  # fmt: skip


HSIAO_CHIRARATTANANON_FREE_EXPONENT = variant(
    HSIAO_CHIRARATTANANON,
    exponent=Parameter("n", "1", 1.0, (0.1, 2.0), normal(0.8, 0.4),
        "exponent of gamma: 1 the paper's convention, 2/3 constant power, 0.6 to 0.8 constant"
        " rpm"),
    name="hsiao_chirarattananon_free_exponent", title="Hsiao-Chirarattananon, free exponent",
    formula=(
        r"\frac{L}{L_\infty} = \left(\frac{1}{2} + \frac{1}{2} \sqrt{1 + \alpha /"
        r" \hat{z}^2}\right)^{n}"
    ),
    checks=(
        Check(0.1, 2.337117, quoted_by="golden value of gamma, n = 1"),
        Check(0.1, 1.761, {"n": 2 / 3}, "own table of gamma^(2/3)", tolerance=5e-4),
    ),
    notes="""\
Ceiling: Hsiao and Chirarattananon's gamma raised to a free power.

    L / L_inf = gamma^n,   gamma = 1/2 + 1/2 sqrt(1 + alpha / z_hat^2)

Convention: alpha as `hsiao_chirarattananon`. n depends on the held quantity: 1 is the paper's
convention, 2/3 constant power. At constant rpm it is below 0.8 and falls towards the ceiling.

Approximation: n is a constant. At constant rpm it is not: the ratio saturates near 2.1 to 2.4 as
gamma grows without bound, without any viscosity.

Refusal: nan where z_hat is not positive.

Traps: far away only the product n alpha is identifiable. n needs stations below z_hat = 0.3, where
a zero error is nearly the same (correlation 0.997).
""",
)  # fmt: skip


MODELS = (
    HSIAO_CHIRARATTANANON,
    HSIAO_CHIRARATTANANON_CONSTANT_POWER,
    HSIAO_CHIRARATTANANON_FREE_EXPONENT,
)
