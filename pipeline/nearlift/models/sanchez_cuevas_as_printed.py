"""Ground, quadrotor: Sanchez-Cuevas as Carter, Bouchard and Quinn print it. For comparison only.

    L / L_inf = 1 / (1 - s)
    s = 1 / (16 z^2) + z / (l^2 + 4 z^2)^(3/2) + z / (2 (2 l^2 + 4 z^2)^(3/2)) + z / (2 K_b (l^2 + 4
    z^2)^(3/2))

with z = z_hat and l = `spacing_hat`. The print has K_b in the denominator and the adjacent spacing
where the original has the diagonal. The fountain is then 7 to 11 times too small at K_b = 2, and
*shrinks* as K_b grows.

Convention: the fountain's strength here is `inverse_K_b` = 1 / K_b, so that a fit is bounded. A
fitted K_b would run to infinity on data without a fountain. It would jump through 0 on data with a
strong or a negative one. The printed K_b = 2 is inverse_K_b = 0.5; the term equals an original one
with b = l and K_b = inverse_K_b / 4.

Approximation and refusal: as `sanchez_cuevas`; nan where nothing of the inflow is left.

Traps: with the printed K_b = 2 the gain at z_hat = 1 is 8.7 %. The text reports up to 20 % and a
good match.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import LiftModel, Parameter, Source, normal
from nearlift.models.inflow import clear_of_boundary, gain, image, tabulated
from nearlift.models.sanchez_cuevas import four_images


def cancelled(z_hat: Any, spacing_hat: Any, inverse_K_b: Any) -> Any:
    """Fraction of inflow cancelled by images and the printed fountain term."""
    return four_images(z_hat, spacing_hat) + inverse_K_b * image(
        2.0 * clear_of_boundary(z_hat), spacing_hat
    )


def evaluate(z_hat: Any, /, *, spacing_hat: Any, inverse_K_b: Any) -> Any:
    """L / L_inf as printed; nan where nothing of the inflow is left. Shapes broadcast."""
    return gain(cancelled(z_hat, spacing_hat, inverse_K_b))


def downwash(z_hat: Any, /, *, spacing_hat: Any, inverse_K_b: Any) -> Any:
    """Induced velocity at the disk over its value far away, 1 - s."""
    return 1.0 - cancelled(z_hat, spacing_hat, inverse_K_b)


MODEL = LiftModel(
    name="sanchez_cuevas_as_printed",
    title="Sanchez-Cuevas, as printed",
    formula=(
        r"\frac{L}{L_\infty} = \left[1 - \frac{1}{16 \hat{z}^2} - \frac{\hat{z}}{(\hat{l}^2 + 4"
        r" \hat{z}^2)^{3/2}}"
        r" - \frac{\hat{z}}{2 (2 \hat{l}^2 + 4 \hat{z}^2)^{3/2}} - \frac{\hat{z}}{2 K_b (\hat{l}^2"
        r" + 4 \hat{z}^2)^{3/2}}\right]^{-1}"
    ),
    evaluate=evaluate,
    downwash=downwash,
    boundary="ground",
    rotors="several",
    parameters=(
        Parameter(
            name="inverse_K_b",
            unit="1",
            value=0.5,
            bounds=(-40.0, 80.0),
            prior=normal(0.5, 16.0),
            meaning=(
                "1 / K_b of the printed equation; positive gains lift, 0 leaves the images alone"
            ),
        ),
    ),
    needs=("spacing_hat",),
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation=(
            "Carter, D. J., Bouchard, L., and Quinn, D. B., Influence of the Ground, Ceiling, and"
            " Sidewall on Micro-Quadrotors, 2021"
        ),
        equation="(2)",
        bibtex=("carter2021",),
        doubts=(
            (
                "Misprint: the original has 2 K_b z_hat over the diagonal; at K_b = 2 the printed"
                " term is 6.7, 8.8, 10.8 times too small at z_hat = 1, 2, 3."
            ),
            (
                "The hat over l is missing in parts of the print; l is scaled by rotor radius"
                " throughout."
            ),
            (
                "l = 90 mm is called the distance between centres of rotors. On a Crazyflie that is"
                " about the diagonal (92 mm); the sides are 65 mm."
            ),
            (
                "Bounds and prior are four times those of K_b in the original, which the term then"
                " covers; they are a choice."
            ),
        ),
    ),
    checks=tabulated(
        (0.5, 1.3530, {"spacing_hat": 90 / 23}, "own table of the printed form, l = 90 mm"),
        (1.0, 1.0866, {"spacing_hat": 90 / 23}, "the same table"),
        (3.0, 1.0203, {"spacing_hat": 90 / 23}, "the same table"),
    ),
    notes=__doc__ or "",
)
