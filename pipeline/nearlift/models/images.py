"""Models of images: lift gained from the inflow that mirrored rotors cancel.

A boundary mirrors each rotor. Seen from above, the mirrored rotor is a source whose flow opposes
the induced inflow at the real one. All images together cancel the fraction `s` of the inflow; the
lift ratio is 1 / (1 - s). Each function here returns s, and its docstring is the model's.

Lengths are scaled by rotor radius. A rotor plane on or behind the boundary has no lift ratio: nan,
never a wrong number. Written in 1/height, so that a height of infinity (free air) gives exactly no
image and a ratio of exactly 1. Shapes broadcast.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import (
    Check,
    Evaluate,
    FloatArray,
    LiftModel,
    Parameter,
    Source,
    normal,
    variant,
)


def clear_of_boundary(z_hat: Any) -> FloatArray:
    """`z_hat` as an array, nan where it is not positive."""
    z = np.asarray(z_hat, dtype=float)
    result: FloatArray = np.where(z > 0, z, np.nan)
    return result


def image(height_hat: Any, separation_hat: Any = 0.0) -> Any:
    """Fraction of a rotor's induced inflow cancelled by one image, positive where lift is gained.

    Shapes broadcast. Approximation: a point source at the image's centre of strength (rotor area) x
    (induced velocity). Its velocity is taken at the rotor's centre, along the boundary's normal.

    Parameters
    ----------
    height_hat : array_like
        Distance between rotor and image along the boundary's normal: 2 z_hat for a flat boundary.
    separation_hat : array_like
        Their distance along the boundary: 0 for a rotor's own image.
    """
    height = np.asarray(height_hat, dtype=float)
    slant = 1.0 + np.square(separation_hat / height)
    return 0.25 / (np.square(height) * slant * np.sqrt(slant))


def spacings(layout_hat: Any) -> FloatArray:
    """Distances of all rotors of a layout from each other, (n, n)."""
    x, y = np.asarray(layout_hat, dtype=float).T
    return np.asarray(np.hypot(np.subtract.outer(x, x), np.subtract.outer(y, y)))


def gain(cancelled: Any) -> FloatArray:
    """Lift over lift far away, 1 / (1 - s); nan at and beyond the pole s = 1, where the theory has
    no answer.
    """
    left = 1.0 - np.asarray(cancelled, dtype=float)
    result: FloatArray = np.divide(1.0, left, out=np.full(left.shape, np.nan), where=left > 0)
    return result


def of_images(
    name: str,
    title: str,
    formula: str,
    cancelled: Evaluate,
    *,
    per_rotor: bool = False,
    **declared: Any,
) -> LiftModel:
    """Model of the ground whose ratio is 1 / (1 - s) and whose downwash is 1 - s.

    Parameters
    ----------
    cancelled
        s, the fraction of inflow that images cancel; its docstring is the model's.
    per_rotor
        Whether s has a last axis of rotors: ratio and downwash of the vehicle are their means.
    declared
        Further fields of `LiftModel`.
    """

    @functools.wraps(cancelled)
    def evaluate(z_hat: Any, /, **values: Any) -> Any:
        ratio = gain(cancelled(z_hat, **values))
        return ratio.mean(axis=-1) if per_rotor else ratio

    @functools.wraps(cancelled)
    def downwash(z_hat: Any, /, **values: Any) -> Any:
        s = cancelled(z_hat, **values)
        return 1.0 - (s.mean(axis=-1) if per_rotor else s)

    return LiftModel(
        name,
        title,
        formula,
        evaluate,
        downwash=downwash,
        boundary="ground",
        valid_z_hat=(0.25, math.inf),
        **declared,
    )


def tabulated(*rows: tuple[float, float, Mapping[str, Any], str]) -> tuple[Check, ...]:
    """Checks against a table of four decimals: z_hat, the ratio there, the arguments, and who
    quoted it.
    """
    return tuple(
        Check(x=z_hat, expected=ratio, arguments=given, tolerance=5e-5, quoted_by=by)
        for z_hat, ratio, given, by in rows
    )


def cheeseman_bennett_cancelled(z_hat: Any, /, *, k: Any) -> Any:
    """Ground: Cheeseman and Bennett's image of one rotor, with a free coefficient.

        L / L_inf = 1 / (1 - k / (16 z_hat^2))

    Convention: z_hat is rotor plane to ground over rotor radius; k > 0 gains lift, k = 1 is the
    theory, k < 0 loses lift. The theory holds power constant and leaves the induced velocity v_i as
    it was without the image. The held quantity matters as much as k: see
    `cheeseman_bennett_constant_power`.

    Approximation: potential flow; one point source for the image; inflow uniform over an infinitely
    thin disk; hover.

    Refusal: at and below the pole, z_hat = sqrt(k) / 4, the ratio is nan. A fit must treat that as
    impossible; with a finite value it could step over the pole and return a k that no station
    allows.

    Quadrotors: the same form with k fitted is the "coefficient on Cheeseman-Bennett" of Danjun et
    al.. Nobahari and Sharifi's equivalent radius of 2.5 R is k = 6.25, whose pole is at z_hat =
    0.625.
    """
    return k * image(2.0 * clear_of_boundary(z_hat))


CHEESEMAN_BENNETT = of_images(
    "cheeseman_bennett", "Cheeseman-Bennett, free coefficient",
    r"\frac{L}{L_\infty} = \frac{1}{1 - k / (16 \hat{z}^2)}", cheeseman_bennett_cancelled,
    parameters=(
        Parameter("k", "1", 1.0, (-8.0, 15.0), normal(1.0, 4.0),
            "strength of the image over the theory's; positive gains lift, 1 is the theory, 0 no"
            " ground effect"),
    ),
    source=Source(
        "Cheeseman, I. C., and Bennett, W. E., The Effect of the Ground on a Helicopter Rotor in"
        " Forward Flight, ARC R&M 3021, written 1955, issued 1957",
        equation="hover limit; Eq. 1 of Carter, Bouchard and Quinn 2021", bibtex=("cheeseman1955",),
        doubts=(
            ("Carter et al. print 1/16z^2 where 1/(16 z_hat^2) is meant, and leave 'in Forward"
             " Flight' out of the title."),
            ("The coefficient is Danjun et al. 2015 (10.1109/ChiCC.2015.7260521); a thesis that"
             " cites it confirms its role. The value 8.6 often quoted is from memory and"
             " unverified, and is not used here."),
            ("The equivalent radius 2.5 R of Nobahari and Sharifi 2014"
             " (10.1016/j.engappai.2014.03.004) was read in a secondary transcription only."),
        ),
    ),
    checks=(
        Check(1.0, 1.066667, quoted_by="golden value, exact from the formula"),
        Check(0.5, 1.333333, quoted_by="golden value, exact from the formula"),
        Check(2.0, 1.015873, quoted_by="golden value, exact from the formula"),
        Check(1.0, 1.641, {"k": 6.25},
            "Nobahari and Sharifi's R_eq = 2.5 R, secondary transcription", tolerance=5e-4),
        Check(2.0, 1.108, {"k": 6.25}, "the same", tolerance=5e-4),
        Check(3.0, 1.045, {"k": 6.25}, "the same", tolerance=5e-4),
    ),
)  # fmt: skip


CHEESEMAN_BENNETT_CONSTANT_POWER = variant(
    CHEESEMAN_BENNETT, exponent=2.0 / 3.0, name="cheeseman_bennett_constant_power",
    title="Cheeseman-Bennett, constant power",
    formula=r"\frac{L}{L_\infty} = \left(1 - \frac{k}{16 \hat{z}^2}\right)^{-2/3}", rotors="one",
    source=Source(
        "Own derivation from momentum theory and the image of Cheeseman and Bennett (ARC R&M 3021)",
        bibtex=("cheeseman1955",), doubts=("Not published in this form; derived here.",)),
    checks=(Check(0.5, 1.211414, quoted_by="(4/3)^(2/3), own arithmetic"),),
    notes="""\
Ground, one rotor: Cheeseman and Bennett's image at constant power, with momentum conserved.

    L / L_inf = (1 - k / (16 z_hat^2))^(-2/3)

Convention: as in `cheeseman_bennett`. The image takes the fraction s = k / (16 z_hat^2) from the
inflow, so the power ratio at constant thrust is 1 - s. Thrust grows as power to the 2/3, hence the
exponent. Cheeseman and Bennett instead leave v_i as it was, which gives the exponent 1.

Approximation: momentum theory; all power is induced power. At constant rpm the exponent lies near
0.6 to 0.8 and falls as the gain grows; at constant throttle it is neither. The exponent is all but
indistinguishable from k in a fit of thrust alone.

Refusal: nan at and below the pole, z_hat = sqrt(k) / 4.
""",
)  # fmt: skip


CHEESEMAN_BENNETT_THEORY = variant(
    CHEESEMAN_BENNETT, held={"k": 1.0}, name="cheeseman_bennett_fixed",
    title="Cheeseman-Bennett, theory",
    formula=r"\frac{L}{L_\infty} = \frac{1}{1 - 1 / (16 \hat{z}^2)}",
    source=replace(CHEESEMAN_BENNETT.source,
        doubts=("Carter et al. print 1/16z^2 where 1/(16 z_hat^2) is meant.",)),
    checks=(
        Check(1.0, 1.066667, quoted_by="golden value, exact from the formula"),
        Check(3.0, 1.0070, tolerance=5e-5, quoted_by="own table of the formula"),
    ),
    notes="""\
Ground: Cheeseman and Bennett as they published it, nothing free.

    L / L_inf = 1 / (1 - 1 / (16 z_hat^2))

The theory curve, which a fit of `cheeseman_bennett` has to beat; the paper calls it "classic
helicopter theory". Convention, approximation and refusal are those of `cheeseman_bennett` with k =
1. The pole is at z_hat = 0.25, and below z_hat = 0.5 the theory is not reliable.
""",
)  # fmt: skip


def four_images(z_hat: Any, spacing_hat: Any) -> Any:
    """Fraction of inflow that the images of four rotors in a square cancel at each of them."""
    height = 2.0 * clear_of_boundary(z_hat)
    return (
        image(height)
        + 2.0 * image(height, spacing_hat)
        + image(height, math.sqrt(2.0) * spacing_hat)
    )


def sanchez_cuevas_cancelled(
    z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any
) -> Any:
    """Ground, quadrotor: Sanchez-Cuevas, Heredia and Ollero, as they published it.

        L / L_inf = 1 / (1 - s)
        s = 1 / (16 z^2) + z / (d^2 + 4 z^2)^(3/2) + z / (2 (2 d^2 + 4 z^2)^(3/2))
            + 2 K_b z / (b^2 + 4 z^2)^(3/2)

    with z = z_hat, d = `spacing_hat` the distance of ADJACENT rotor axes and b = `diagonal_hat` the
    distance of OPPOSITE ones.

    Convention: K_b > 0 gains lift: the fountain pushes on the body. K_b < 0 loses it: the fountain
    is drawn in again. K_b = 0 leaves the images of four rotors in a square. The fountain term is
    K_b times four images at the distance b.

    Approximation: potential flow, point sources, uniform inflow, four rotors in a square. K_b is
    empirical. The paper takes the ratio at constant throttle, the theory at constant power with v_i
    unchanged. The exponent n in (L / L_inf)^n, K_b and a zero error of the distance are nearly
    confounded. K_b is evidence for a fountain only if zero and n are known from elsewhere.

    Refusal: nan where the images cancel the whole inflow (z_hat just above 0.25). Measured curves
    start near z_hat = 0.5.

    Traps: the paper prints this equation with K_b in the denominator and one spacing throughout
    (`sanchez_cuevas_as_printed`), and calls 90 mm the spacing. A Crazyflie's rotors are 65 mm
    apart, 92 mm across the diagonal.
    """
    fountain = 4.0 * K_b * image(2.0 * clear_of_boundary(z_hat), diagonal_hat)
    return four_images(z_hat, spacing_hat) + fountain


_CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
_PAPER = {"spacing_hat": 90 / 23, "diagonal_hat": math.sqrt(2) * 90 / 23}


SANCHEZ_CUEVAS = of_images(
    "sanchez_cuevas", "Sanchez-Cuevas",
    r"\frac{L}{L_\infty} = \left[1 - \frac{1}{16 \hat{z}^2} - \frac{\hat{z}}{(\hat{d}^2 + 4"
    r" \hat{z}^2)^{3/2}} - \frac{\hat{z}}{2 (2 \hat{d}^2 + 4 \hat{z}^2)^{3/2}} - \frac{2 K_b"
    r" \hat{z}}{(\hat{b}^2 + 4 \hat{z}^2)^{3/2}}\right]^{-1}",
    sanchez_cuevas_cancelled, rotors="several", needs=("spacing_hat", "diagonal_hat"),
    parameters=(
        Parameter("K_b", "1", 2.0, (-10.0, 20.0), normal(2.0, 4.0),
            "strength of the fountain beneath the body; positive gains lift, negative where the"
            " fountain is drawn in again", plausible=(0.0, 6.0)),
    ),
    source=Source(
        "Sanchez-Cuevas, P., Heredia, G., and Ollero, A., Characterization of the Aerodynamic"
        " Ground Effect and Its Influence in Multirotor Control, Int. J. Aerospace Engineering,"
        " 2017",
        equation="(4)", bibtex=("sanchezcuevas2017",), doi="10.1155/2017/1823056",
        doubts=(
            ("Read in transcriptions that cite the equation by number, not in the original; four"
             " that were written independently agree."),
            ("One thesis writes the fountain term with d in place of b; taken as its slip, since"
             " only b makes the term four diagonal images."),
            ("Eq. 2 of Carter, Bouchard and Quinn 2021 differs (K_b in the denominator, one"
             " spacing); see sanchez_cuevas_as_printed."),
            ("K_b about 2 is the value of the original authors; Carter et al. quote the same 2 as"
             " an original and as a new fit, without uncertainty."),
            ("Derived for four rotors in a square; for other numbers of rotors `images` is the"
             " consistent form."),
        ),
    ),
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "own table of the original form, Crazyflie 65 / 92 mm"),
        (0.5, 1.4299, _CRAZYFLIE, "the same table"),
        (5.0, 1.0256, _CRAZYFLIE, "the same table"),
        (1.0, 1.1066, _PAPER, "own table of the original form, d = 90 mm"),
        (1.0, 1.0831, {**_PAPER, "K_b": 0.0}, "own table, images only")),
)  # fmt: skip


SANCHEZ_CUEVAS_PUBLISHED = variant(
    SANCHEZ_CUEVAS, held={"K_b": 2.0}, name="sanchez_cuevas_published",
    title="Sanchez-Cuevas, K_b = 2",
    formula=SANCHEZ_CUEVAS.formula.replace("2 K_b", "4"),
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "table of sanchez_cuevas"),
        (5.0, 1.0256, _CRAZYFLIE, "the same table")),
    notes="""\
Ground, quadrotor: Sanchez-Cuevas, Heredia and Ollero with the fountain's strength that they
published, nothing free.

The formula is that of `sanchez_cuevas` with K_b = 2 and the vehicle's own geometry: spacing d
between ADJACENT axes, b across the diagonal. Convention, approximation, refusal and traps are those
of `sanchez_cuevas`.

Purpose: the fit of K_b has to beat it by more than the trials' errors, or K_b = 2 is sufficient.
""",
)  # fmt: skip


SANCHEZ_CUEVAS_FREE_EXPONENT = variant(
    SANCHEZ_CUEVAS,
    exponent=Parameter("n", "1", 1.0, (0.1, 2.0), normal(0.8, 0.4),
        "exponent of the ratio: 1 the paper's convention, 2/3 constant power, 0.6 to 0.8 constant"
        " rpm"),
    name="sanchez_cuevas_free_exponent", title="Sanchez-Cuevas, free exponent",
    formula=r"\frac{L}{L_\infty} = \left(1 - s(\hat{z}; \hat{d}, \hat{b}, K_b)\right)^{-n}",
    source=Source(
        "Own unification of what published ratios hold constant, over "
        + SANCHEZ_CUEVAS.source.citation,
        doi=SANCHEZ_CUEVAS.source.doi, bibtex=SANCHEZ_CUEVAS.source.bibtex,
        doubts=(
            ("The range of n at constant rpm comes from an own blade-element closure with"
             " solidity times lift slope 0.75 to 1.14."),
        ),
    ),
    checks=tabulated(
        (1.0, 1.1586, _CRAZYFLIE, "sanchez_cuevas at n = 1"),
        (1.0, 1.1586 ** (2 / 3), {**_CRAZYFLIE, "n": 2 / 3}, "the same to the 2/3, own arithmetic"),
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
)  # fmt: skip


def as_printed_cancelled(z_hat: Any, /, *, spacing_hat: Any, inverse_K_b: Any) -> Any:
    """Ground, quadrotor: Sanchez-Cuevas as Carter, Bouchard and Quinn print it.

        L / L_inf = 1 / (1 - s)
        s = 1 / (16 z^2) + z / (l^2 + 4 z^2)^(3/2) + z / (2 (2 l^2 + 4 z^2)^(3/2))
            + z / (2 K_b (l^2 + 4 z^2)^(3/2))

    with z = z_hat and l = `spacing_hat`. The print has K_b in the denominator and the adjacent
    spacing where the original has the diagonal. The fountain is then 7 to 11 times too small at K_b
    = 2, and *shrinks* as K_b grows. It is here for comparison only.

    Convention: the fountain's strength here is `inverse_K_b` = 1 / K_b, so that a fit is bounded. A
    fitted K_b would run to infinity on data without a fountain. It would jump through 0 on data
    with a strong or a negative one. The printed K_b = 2 is inverse_K_b = 0.5; the term equals an
    original one with b = l and K_b = inverse_K_b / 4.

    Approximation and refusal: as `sanchez_cuevas`; nan where nothing of the inflow is left.

    Traps: with the printed K_b = 2 the gain at z_hat = 1 is 8.7 %. The text reports up to 20 % and
    a good match.
    """
    fountain = inverse_K_b * image(2.0 * clear_of_boundary(z_hat), spacing_hat)
    return four_images(z_hat, spacing_hat) + fountain


SANCHEZ_CUEVAS_AS_PRINTED = of_images(
    "sanchez_cuevas_as_printed", "Sanchez-Cuevas, as printed",
    r"\frac{L}{L_\infty} = \left[1 - \frac{1}{16 \hat{z}^2} - \frac{\hat{z}}{(\hat{l}^2 + 4"
    r" \hat{z}^2)^{3/2}} - \frac{\hat{z}}{2 (2 \hat{l}^2 + 4 \hat{z}^2)^{3/2}} - \frac{\hat{z}}{2"
    r" K_b (\hat{l}^2 + 4 \hat{z}^2)^{3/2}}\right]^{-1}",
    as_printed_cancelled, rotors="several", needs=("spacing_hat",),
    parameters=(
        Parameter("inverse_K_b", "1", 0.5, (-40.0, 80.0), normal(0.5, 16.0),
            "1 / K_b of the printed equation; positive gains lift, 0 leaves the images alone"),
    ),
    source=Source(
        "Carter, D. J., Bouchard, L., and Quinn, D. B., Influence of the Ground, Ceiling, and"
        " Sidewall on Micro-Quadrotors, 2021",
        equation="(2)", bibtex=("carter2021",),
        doubts=(
            ("Misprint: the original has 2 K_b z_hat over the diagonal; at K_b = 2 the printed"
             " term is 6.7, 8.8, 10.8 times too small at z_hat = 1, 2, 3."),
            ("The hat over l is missing in parts of the print; l is scaled by rotor radius"
             " throughout."),
            ("l = 90 mm is called the distance between centres of rotors. On a Crazyflie that is"
             " about the diagonal (92 mm); the sides are 65 mm."),
            ("Bounds and prior are four times those of K_b in the original, which the term then"
             " covers; they are a choice."),
        ),
    ),
    checks=tabulated(
        (0.5, 1.3530, {"spacing_hat": 90 / 23}, "own table of the printed form, l = 90 mm"),
        (1.0, 1.0866, {"spacing_hat": 90 / 23}, "the same table"),
        (3.0, 1.0203, {"spacing_hat": 90 / 23}, "the same table")),
)  # fmt: skip


def square(spacing_hat: float) -> tuple[tuple[float, float], ...]:
    """Layout of four rotors in a square of that side."""
    a = 0.5 * spacing_hat
    return ((a, a), (-a, a), (-a, -a), (a, -a))


def level_cancelled(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """Ground, any layout: the sum of all rotors' images.

        s_i = (1/4) sum_j 2 z / (h_ij^2 + 4 z^2)^(3/2)
        L / L_inf = mean over i of 1 / (1 - s_i)

    with z = z_hat and h_ij the distance of rotors i and j, both over rotor radius. Nothing is free.

    Convention: `layout_hat` has a row (x, y) per rotor, in the rotor plane.

    Approximation: potential flow, point sources, equal rotors of equal lift far away, no fountain.

    Refusal: nan at or behind the boundary, and where nothing of the inflow is left.

    One rotor gives Cheeseman and Bennett; four in a square give Sanchez-Cuevas with K_b = 0.
    """
    height = 2.0 * clear_of_boundary(z_hat)[..., None, None]
    return image(height, spacings(layout_hat)).sum(axis=-1)


IMAGES = of_images(
    "images", "Images of all rotors",
    r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad s_i = \frac{1}{4} \sum_j"
    r" \frac{2 \hat{z}}{(\hat{h}_{ij}^2 + 4 \hat{z}^2)^{3/2}}",
    level_cancelled, per_rotor=True, rotors="several", needs=("layout_hat",),
    source=Source(
        "Method of images of Cheeseman and Bennett, per rotor after Sanchez-Cuevas, Heredia and"
        " Ollero 2017 (10.1155/2017/1823056)",
        equation="(10) and section 2.3, as transcribed",
        bibtex=("cheeseman1955", "sanchezcuevas2017"),
        doubts=(
            ("The per-rotor form was read in a transcription that cites the equation by number;"
             " that each flat term is one image is an own derivation."),
        ),
    ),
    checks=(
        *tabulated(
            (1.0, 1.0831, {"layout_hat": square(90 / 23)}, "own table, K_b = 0, d = 90 mm"),
            (0.5, 1.3495, {"layout_hat": square(90 / 23)}, "the same table")),
        Check(1.0, 1.066667, {"layout_hat": ((0.0, 0.0),)}, "Cheeseman and Bennett, one rotor"),
    ),
)  # fmt: skip


def tilted_cancelled(z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any) -> Any:
    """Ground, any layout, tilted: each rotor at its own distance.

        s_i = (cos t / 4) sum_j 2 z_j / (h_ij^2 + (z_i + z_j)^2)^(3/2),   z_i = z + x_i sin t

    with t the tilt, z_i the distance of rotor i from the boundary and h_ij the distance of rotors i
    and j along it. t is each trial's `tilt`, a column of the schedule or one of `[trials]
    constants`. At tilt 0 it is `images`.

    Convention: the tilt is about y, positive where rotors at positive x are farther from the
    boundary. z_hat is measured to the layout's origin, along the boundary's normal. The inflow of a
    rotor is counted along its axis. Along the boundary's normal z_i + z_j would take the place of
    2 z_j. The sum over rotors would be the same but for cos t. The levelling moment of a Crazyflie
    would be 1.18, 1.35 and 1.46 times smaller at z_hat = 1.14, 2 and 4.

    Approximation: that of `images`; lift is along the rotor axes, so a cell that does not tilt with
    the vehicle reads less by the cosine. Wakes and wall jets that a tilt turns are not in it.

    Refusal: nan where a rotor is at or behind the boundary.

    Traps: a tilt about another point than the layout's origin is a change of distance, of first
    order. The effect `tilt` has it, and has the second order of this model with a free strength.
    Use one of the two.
    """
    x, y = np.asarray(layout_hat, dtype=float).T
    tilt = np.asarray(tilt_rad, dtype=float)[..., None]
    z = clear_of_boundary(np.asarray(z_hat, dtype=float)[..., None] + x * np.sin(tilt))
    height = z[..., :, None] + z[..., None, :]
    sine, cosine = np.sin(tilt)[..., None], np.cos(tilt)[..., None]
    lengthwise = np.subtract.outer(x, x)
    apart = np.hypot(lengthwise * cosine, np.subtract.outer(y, y))
    # 2 z_j cos t over z_i + z_j: the image's flow along the tilted axis over that along the normal
    axial = cosine * (1.0 - lengthwise * sine / height)
    return (image(height, apart) * axial).sum(axis=-1)


IMAGES_TILTED = of_images(
    "images_tilted", "Images of all rotors, tilted",
    r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad s_i ="
    r" \frac{\cos\theta}{4} \sum_j \frac{2 \hat{z}_j}{[\hat{h}_{ij}^2 + (\hat{z}_i +"
    r" \hat{z}_j)^2]^{3/2}}, \quad \hat{z}_i = \hat{z} + \hat{x}_i \sin\theta",
    tilted_cancelled, per_rotor=True, rotors="several", needs=("layout_hat", "tilt_rad"),
    source=replace(IMAGES.source,
        doubts=(
            *IMAGES.source.doubts,
            "The published per-rotor form counts the inflow along the boundary's normal.",
        ),
    ),
    checks=(
        Check(1.0, 1.0831, {"layout_hat": square(90 / 23), "tilt_rad": 0.0},
            "own table, K_b = 0, d = 90 mm, level", tolerance=5e-5),
        Check(1.0, 0.5 / (1 - 1 / 16 / 1.1**2) + 0.5 / (1 - 1 / 16 / 0.9**2),
            {"layout_hat": ((100.0, 0.0), (-100.0, 0.0)), "tilt_rad": math.asin(0.001)},
            "two rotors far apart, by hand: Cheeseman and Bennett at 1.1 and 0.9", tolerance=1e-6),
    ),
)  # fmt: skip


def image_share(edge_hat: Any, height_hat: Any, separation_hat: Any) -> Any:
    """Share of an image in a boundary that ends at a straight edge. Shapes broadcast.

    The distance of the edge is from the point midway between rotor and source. An image represents
    sources spread over the boundary. Their part in a rotor's inflow, counted up to the edge, is
    1/2 + 3/4 t - t^3 / 4. t is the sine of the angle between the boundary's normal and the edge:
    1/2 with the edge beneath. The share is exact for a rotor's own image; between two rotors
    sources count by their distance from the midpoint.
    """
    sine = np.sin(np.arctan2(edge_hat, 0.5 * np.hypot(height_hat, separation_hat)))
    return 0.5 + sine * (0.75 - 0.25 * np.square(sine))


def edge_cancelled(z_hat: Any, /, *, layout_hat: Any, edge_hat: Any) -> Any:
    """Ground, any layout, that ends at a straight edge: a vehicle over the rim of a table.

    Each image counts by the share of it that exists, from 1 through 1/2 with the edge beneath to 0.
    `t` is the sine of the angle of the edge from a point midway between rotor and source. The
    nearer the boundary, the sharper is the step. Far above it an edge matters from as far away as
    the distance to the ground. Nothing is free.

    Convention: the boundary fills x <= e, e = `[rig] edge` over rotor radius, from the layout's
    origin. e is negative where the vehicle's centre is beyond the edge.

    Approximation: that of `images`; no fountain, nothing below the edge.

    Traps: the effect `plate_edge` is for a plate whose end is not in the manifest; it estimates the
    spread of the wake. With the edge known, this is the model, and the effect is a possible
    remainder.
    """
    x, apart = np.asarray(layout_hat, dtype=float)[:, 0], spacings(layout_hat)
    height = 2.0 * clear_of_boundary(z_hat)[..., None, None]
    share = image_share(edge_hat - 0.5 * np.add.outer(x, x), height, apart)
    return (image(height, apart) * share).sum(axis=-1)


IMAGES_EDGE = of_images(
    "images_edge", "Images of all rotors, partial ground",
    r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad s_i = \frac{1}{4} \sum_j"
    r" \left(\tfrac{1}{2} + \tfrac{3}{4} t_{ij} - \tfrac{1}{4} t_{ij}^3\right) \frac{2"
    r" \hat{z}}{(\hat{h}_{ij}^2 + 4 \hat{z}^2)^{3/2}}, \quad t_{ij} ="
    r" \frac{\hat{e}_{ij}}{\sqrt{\hat{e}_{ij}^2 + \hat{z}^2 + \hat{h}_{ij}^2 / 4}}, \quad"
    r" \hat{e}_{ij} = \hat{e} - \frac{\hat{x}_i + \hat{x}_j}{2}",
    edge_cancelled, per_rotor=True, rotors="several", needs=("layout_hat", "edge_hat"),
    source=Source(
        "Own derivation from the images of Cheeseman and Bennett, per rotor after Sanchez-Cuevas,"
        " Heredia and Ollero 2017 (10.1155/2017/1823056)",
        bibtex=("cheeseman1955", "sanchezcuevas2017"),
        doubts=(
            ("The sources on the boundary are those of a boundary without end. The edge's own"
             " part (diffraction, a jet that separates there) is left out."),
            ("Between two rotors the share is that about their midpoint. The lift of a"
             " Crazyflie differs from the sum over the boundary by at most 0.35 % at z_hat = 0.5."
             " The limit is 0.18 % at 1 and 0.05 % at 2."),
            ("No published form says what the fountain does when part of the vehicle has no"
             " ground beneath it; there is none here."),
        ),
    ),
    checks=(
        Check(1.0, 1.0831, {"layout_hat": square(90 / 23), "edge_hat": math.inf},
            "own table, K_b = 0, d = 90 mm, no edge", tolerance=5e-5),
        Check(1.0, 1 / (1 - 1 / 32), {"layout_hat": ((0.0, 0.0),), "edge_hat": 0.0},
            "by hand: half of one rotor's image, the edge beneath its axis"),
        Check(3.0, 1 / (1 - 0.972 / 144), {"layout_hat": ((0.0, 0.0),), "edge_hat": 4.0},
            "by hand: t = 4/5, a share of 0.5 + 0.6 - 0.128 = 0.972"),
    ),
)  # fmt: skip


#: Orders of reflection that `corridor` sums.
REFLECTIONS = 16


def reflected(z_hat: Any, layout_hat: Any, gap_hat: float) -> Iterator[FloatArray]:
    """Inflow cancelled at each rotor by the images of order n, (..., rotors); 0 is the ground."""
    z = np.asarray(z_hat, dtype=float)
    free = np.isposinf(z)
    z = np.where(free, 0.5 * min(gap_hat, 2.0), z)
    z = np.where(np.isnan(clear_of_boundary(gap_hat - z)), np.nan, clear_of_boundary(z))
    z, apart = z[..., None, None], spacings(layout_hat)
    yield np.where(free[..., None], 0.0, image(2.0 * z, apart).sum(axis=-1))
    for n in range(1, REFLECTIONS + 1):
        far = 2.0 * n * gap_hat
        pairs = image(far + 2.0 * z, apart) + image(far - 2.0 * z, apart) - 2.0 * image(far, apart)
        yield np.where(free[..., None], 0.0, pairs.sum(axis=-1))


def corridor_cancelled(z_hat: Any, /, *, layout_hat: Any, gap_hat: Any, kappa: Any) -> Any:
    """Ground and ceiling at once, any layout: the images of both, and the images of those.

        s_i = sum_j I(2 z, h_ij)
              + sum_n kappa^n sum_j [I(2 n g + 2 z, h_ij) + I(2 n g - 2 z, h_ij) - 2 I(2 n g, h_ij)]
        L / L_inf = mean over i of 1 / (1 - s_i),   I(H, h) = (H / 4) / (h^2 + H^2)^(3/2)

    with z = z_hat from the ground, g = `[rig] gap` over r from ground to ceiling, h_ij the distance
    of rotors i and j. n = 1 has four images: the ceiling's own (2 g - 2 z), one in both planes with
    the ground last (2 g + 2 z), and two that are mirrored twice (2 g). The two blow as the rotor
    does and draw more air through it; a single mirror turns the rotor round.

    What is mirrored: the rotor, not Cheeseman and Bennett's source. The image of a source at a
    ceiling would add downwash and lose lift. The mirrored rotor draws air from the ceiling's
    plane as the real one does. Seen from below it is a sink, whose flow rises through the real
    rotor and takes from the downwash. The sign is that of measured lift near a ceiling.

    Convention: kappa is the share of an image that the ceiling gives, and counts once for each
    reflection in it. 1 is a mirror, 0 no ceiling. 1/2 is the far limit of Hsiao and
    Chirarattananon's theory: gamma = 1 + 1 / (32 z^2), where an image has 1 + 1 / (16 z^2). Trials
    are counted from the ground, as `boundary = "ground"`; free air has neither boundary.

    Approximation: that of `images`. Near the ceiling radial inflow dominates, which no image has;
    the wake that fills a corridor and returns is not in it. Sixteen orders: in a gap of 2 radii or
    more the omitted ones cancel less than 1e-5 of the inflow.

    Two sidewalls have no model of this kind. The image of a rotor in a wall makes no axial inflow
    at it, nor does any image of that (`sidewall_none`). No one has measured a sum of two losses.

    Refusal: nan at or behind either boundary, and where nothing of the inflow is left.

    A gap without end, or kappa = 0, gives `images`; one rotor between mirrors gives 1 - s with s =
    (pi / g)^2 (1 / sin^2(pi z / g) - 1 / 3) / 16.
    """
    share = np.asarray(kappa, dtype=float)[..., None]
    orders = reflected(z_hat, layout_hat, gap_hat)
    return sum((share**n * part for n, part in enumerate(orders)), start=np.zeros(1))


_ONE = ((0.0, 0.0),)
CORRIDOR = of_images(
    "corridor", "Corridor, images of ground and ceiling",
    r"\frac{L}{L_\infty} = \frac{1}{m} \sum_i \frac{1}{1 - s_i}, \quad s_i = \sum_j"
    r" \left\{I_{ij}(2 \hat{z}) + \sum_{n \geq 1} \kappa^n \left[I_{ij}(2 n \hat{g} + 2 \hat{z}) +"
    r" I_{ij}(2 n \hat{g} - 2 \hat{z}) - 2 I_{ij}(2 n \hat{g})\right]\right\}, \quad I_{ij}(H) ="
    r" \frac{H / 4}{(\hat{h}_{ij}^2 + H^2)^{3/2}}",
    corridor_cancelled, per_rotor=True, needs=("layout_hat", "gap_hat"),
    parameters=(
        Parameter("kappa", "1", 0.5, (0.0, 1.0), normal(0.5, 0.25),
            "share of an image that the ceiling gives: 1 a mirror, 0 no ceiling"),
    ),
    source=Source(
        "Own sum of the images of Cheeseman and Bennett in two planes. Per rotor after"
        " Sanchez-Cuevas, Heredia and Ollero 2017 (10.1155/2017/1823056). The ceiling's share"
        " after Hsiao and Chirarattananon 2019 (10.1109/TMECH.2019.2929589)",
        bibtex=("cheeseman1955", "sanchezcuevas2017", "hsiao2019"),
        doubts=(
            "No measurement of a small rotor between ground and ceiling was at hand.",
            ("The ceiling's image is a sink, a choice whose sign fits measured lift. The image of"
             " Cheeseman and Bennett's source would add downwash and lose lift."),
            ("That an image mirrored twice draws more air through the rotor follows from the"
             " mirror, not from a wake that has met both boundaries."),
            ("Rossow 1985 (NASA TM-86754) has both planes by vortex cylinders; read in abstract"
             " alone."),
        ),
    ),
    checks=(
        Check(1.0, 1.0831, {"layout_hat": square(90 / 23), "gap_hat": math.inf},
            "own table of the ground alone, K_b = 0, d = 90 mm", tolerance=5e-5),
        Check(2.0, 1 / (1 - (math.pi / 4) ** 2 * (1 - 1 / 3) / 16),
            {"layout_hat": _ONE, "gap_hat": 4.0, "kappa": 1.0},
            "sum over all images of one rotor midway between mirrors, own algebra", tolerance=1e-5),
        Check(1.0, 1.067623, {"layout_hat": _ONE, "gap_hat": 4.0},
            "by hand to second order: (1 + (1/25 + 1/9 - 2/16)/2 + (1/81 + 1/49 - 2/64)/4) / 16",
            tolerance=5e-6),
    ),
)  # fmt: skip


MODELS = (
    SANCHEZ_CUEVAS,
    SANCHEZ_CUEVAS_PUBLISHED,
    SANCHEZ_CUEVAS_FREE_EXPONENT,
    SANCHEZ_CUEVAS_AS_PRINTED,
    IMAGES,
    IMAGES_TILTED,
    IMAGES_EDGE,
    CORRIDOR,
    CHEESEMAN_BENNETT,
    CHEESEMAN_BENNETT_CONSTANT_POWER,
    CHEESEMAN_BENNETT_THEORY,
)
