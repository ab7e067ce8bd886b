"""Ground, quadrotor: Sanchez-Cuevas, Heredia and Ollero, as they published it.

    L / L_inf = 1 / (1 - s)
    s = 1 / (16 z^2) + z / (d^2 + 4 z^2)^(3/2) + z / (2 (2 d^2 + 4 z^2)^(3/2)) + 2 K_b z / (b^2 + 4
    z^2)^(3/2)

with z = z_hat, d = `spacing_hat` the distance of ADJACENT rotor axes and b = `diagonal_hat` the
distance of OPPOSITE ones.

Convention: K_b > 0 gains lift: the fountain pushes on the body. K_b < 0 loses it: the fountain is
drawn in again. K_b = 0 leaves the images of four rotors in a square. The fountain term is K_b times
four images at the distance b.

Approximation: potential flow, point sources, uniform inflow, four rotors in a square. K_b is
empirical. The paper takes the ratio at constant throttle, the theory at constant power with v_i
unchanged. The exponent n in (L / L_inf)^n, K_b and a zero error of the distance are nearly
confounded. K_b is evidence for a fountain only if zero and n are known from elsewhere.

Refusal: nan where the images cancel the whole inflow (z_hat just above 0.25). Measured curves start
near z_hat = 0.5.

Traps: the paper prints this equation with K_b in the denominator and one spacing throughout
(`sanchez_cuevas_as_printed`), and calls 90 mm the spacing. A Crazyflie's rotors are 65 mm apart, 92
mm across the diagonal.
"""

from __future__ import annotations

import math
from typing import Any

from nearlift.declare import LiftModel, Parameter, Source, normal, variant
from nearlift.models.inflow import clear_of_boundary, gain, image, tabulated


def four_images(z_hat: Any, spacing_hat: Any) -> Any:
    """Fraction of inflow that the images of four rotors in a square cancel at each of them."""
    height = 2.0 * clear_of_boundary(z_hat)
    return (
        image(height)
        + 2.0 * image(height, spacing_hat)
        + image(height, math.sqrt(2.0) * spacing_hat)
    )


def cancelled(z_hat: Any, spacing_hat: Any, diagonal_hat: Any, K_b: Any) -> Any:
    """Fraction of inflow cancelled by images and fountain."""
    return four_images(z_hat, spacing_hat) + 4.0 * K_b * image(
        2.0 * clear_of_boundary(z_hat), diagonal_hat
    )


def evaluate(z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any) -> Any:
    """L / L_inf; nan where nothing of the inflow is left. Shapes broadcast."""
    return gain(cancelled(z_hat, spacing_hat, diagonal_hat, K_b))


def downwash(z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any) -> Any:
    """Induced velocity at the disk over its value far away, 1 - s."""
    return 1.0 - cancelled(z_hat, spacing_hat, diagonal_hat, K_b)


FOUNTAIN = Parameter(
    name="K_b",
    unit="1",
    value=2.0,
    bounds=(-10.0, 20.0),
    prior=normal(2.0, 4.0),
    meaning=(
        "strength of the fountain beneath the body; positive gains lift, negative where the"
        " fountain is drawn in again (plausible: -2 to 6)"
    ),
)

SOURCE = Source(
    citation=(
        "Sanchez-Cuevas, P., Heredia, G., and Ollero, A., Characterization of the Aerodynamic"
        " Ground Effect and Its Influence in Multirotor Control, Int. J. Aerospace Engineering,"
        " 2017"
    ),
    equation="(4)",
    bibtex=("sanchezcuevas2017",),
    doi="10.1155/2017/1823056",
    doubts=(
        (
            "Read in transcriptions that cite the equation by number, not in the original; four"
            " that were written independently agree."
        ),
        (
            "One thesis writes the fountain term with d in place of b; taken as its slip, since"
            " only b makes the term four diagonal images."
        ),
        (
            "Eq. 2 of Carter, Bouchard and Quinn 2021 differs (K_b in the denominator, one"
            " spacing); see sanchez_cuevas_as_printed."
        ),
        (
            "K_b about 2 is the value of the original authors; Carter et al. quote the same 2 as an"
            " original and as a new fit, without uncertainty."
        ),
        (
            "Derived for four rotors in a square; for other numbers of rotors `images` is the"
            " consistent form."
        ),
    ),
)

_CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
_PAPER = {"spacing_hat": 90 / 23, "diagonal_hat": math.sqrt(2) * 90 / 23}

MODEL = LiftModel(
    name="sanchez_cuevas",
    title="Sanchez-Cuevas",
    formula=(
        r"\frac{L}{L_\infty} = \left[1 - \frac{1}{16 \hat{z}^2} - \frac{\hat{z}}{(\hat{d}^2 + 4"
        r" \hat{z}^2)^{3/2}}"
        r" - \frac{\hat{z}}{2 (2 \hat{d}^2 + 4 \hat{z}^2)^{3/2}} - \frac{2 K_b \hat{z}}{(\hat{b}^2"
        r" + 4 \hat{z}^2)^{3/2}}\right]^{-1}"
    ),
    evaluate=evaluate,
    downwash=downwash,
    boundary="ground",
    rotors="several",
    parameters=(FOUNTAIN,),
    needs=("spacing_hat", "diagonal_hat"),
    valid_z_hat=(0.25, float("inf")),
    source=SOURCE,
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "own table of the original form, Crazyflie 65 / 92 mm"),
        (0.5, 1.4299, _CRAZYFLIE, "the same table"),
        (5.0, 1.0256, _CRAZYFLIE, "the same table"),
        (1.0, 1.1066, _PAPER, "own table of the original form, d = 90 mm"),
        (1.0, 1.0831, {**_PAPER, "K_b": 0.0}, "own table, images only"),
    ),
    notes=__doc__ or "",
)


PUBLISHED = variant(
    MODEL,
    held={"K_b": 2.0},
    name="sanchez_cuevas_published",
    title="Sanchez-Cuevas, K_b = 2",
    formula=MODEL.formula.replace("2 K_b", "4"),
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "table of sanchez_cuevas"),
        (5.0, 1.0256, _CRAZYFLIE, "the same table"),
    ),
    notes="""\
Ground, quadrotor: Sanchez-Cuevas, Heredia and Ollero with the fountain's strength that they
published, nothing free.

The formula is that of `sanchez_cuevas` with K_b = 2 and the vehicle's own geometry: spacing d
between ADJACENT axes, b across the diagonal. Convention, approximation, refusal and traps are those
of `sanchez_cuevas`.

Purpose: the fit of K_b has to beat it by more than the trials' errors, or K_b = 2 is sufficient.
""",
)


EXPONENT = Parameter(
    name="n",
    unit="1",
    value=1.0,
    bounds=(0.1, 2.0),
    prior=normal(0.8, 0.4),
    meaning=(
        "exponent of the ratio: 1 the paper's convention, 2/3 constant power, 0.6 to 0.8"
        " constant rpm"
    ),
)

FREE_EXPONENT = variant(
    MODEL,
    exponent=EXPONENT,
    name="sanchez_cuevas_free_exponent",
    title="Sanchez-Cuevas, free exponent",
    formula=r"\frac{L}{L_\infty} = \left(1 - s(\hat{z}; \hat{d}, \hat{b}, K_b)\right)^{-n}",
    source=Source(
        citation="Own unification of what published ratios hold constant, over " + SOURCE.citation,
        doi=SOURCE.doi,
        bibtex=SOURCE.bibtex,
        doubts=(
            (
                "The range of n at constant rpm comes from an own blade-element closure with"
                " solidity times lift slope 0.75 to 1.14."
            ),
        ),
    ),
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "sanchez_cuevas at n = 1"),
        (
            1.0,
            1.1586 ** (2 / 3),
            {**_CRAZYFLIE, "n": 2 / 3},
            "the same to the 2/3, own arithmetic",
        ),
    ),
    notes="""\
Ground, quadrotor: Sanchez-Cuevas raised to a free power.

    L / L_inf = (1 / (1 - s))^n,   s as in `sanchez_cuevas`

Convention: K_b as in `sanchez_cuevas`; n depends on the held quantity. n = 1 is the paper's
convention (v_i unchanged by the image), 2/3 constant power with momentum conserved. At constant rpm
n is about 0.6 to 0.8, falling as the gain grows. The paper's models "scaled by powers of 0.6 ...
1.4" are this family.

Approximation: n is a constant, which only the first two cases are.

Refusal: nan where nothing of the inflow is left.

Traps: thrust alone cannot distinguish K_b from n (correlation -0.99 to -1.00). Record rpm and
power, or use the product only.
""",
)
