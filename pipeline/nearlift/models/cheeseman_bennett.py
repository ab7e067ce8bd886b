"""Ground: Cheeseman and Bennett's image of one rotor, with a free coefficient.

    L / L_inf = 1 / (1 - k / (16 z_hat^2))

Convention: z_hat is rotor plane to ground over rotor radius; k > 0 gains lift, k = 1 is the theory,
k < 0 loses lift. The theory holds power constant and leaves the induced velocity v_i as it was
without the image. The quantity that a trial holds constant matters as much as k: see
`cheeseman_bennett_constant_power`.

Approximation: potential flow; one point source for the image; inflow uniform over an infinitely
thin disk; hover.

Refusal: at and below the pole, z_hat = sqrt(k) / 4, the ratio is nan. A fit must treat that as
impossible; with a finite value it could step over the pole and return a k that no station allows.

Quadrotors: the same form with k fitted is the "coefficient on Cheeseman-Bennett" of Danjun et al..
Nobahari and Sharifi's equivalent radius of 2.5 R is k = 6.25, whose pole is at z_hat = 0.625.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel, Parameter, Source, normal, variant
from nearlift.models.inflow import clear_of_boundary, gain, image


def cancelled(z_hat: Any, k: Any) -> Any:
    """Fraction of inflow cancelled by k times the rotor's own image: k / (16 z_hat^2)."""
    return k * image(2.0 * clear_of_boundary(z_hat))


def evaluate(z_hat: Any, /, *, k: Any) -> Any:
    """L / L_inf; nan at and below the pole sqrt(k) / 4. Shapes broadcast."""
    return gain(cancelled(z_hat, k))


def downwash(z_hat: Any, /, *, k: Any) -> Any:
    """Induced velocity at the disk over its value far away, 1 - s."""
    return 1.0 - cancelled(z_hat, k)


COEFFICIENT = Parameter(
    name="k",
    unit="1",
    value=1.0,
    bounds=(-8.0, 15.0),
    prior=normal(1.0, 4.0),
    meaning=(
        "strength of the image over the theory's; positive gains lift, 1 is the theory, 0 no ground"
        " effect"
    ),
)

MODEL = LiftModel(
    name="cheeseman_bennett",
    title="Cheeseman-Bennett, free coefficient",
    formula=r"\frac{L}{L_\infty} = \frac{1}{1 - k / (16 \hat{z}^2)}",
    evaluate=evaluate,
    downwash=downwash,
    boundary="ground",
    parameters=(COEFFICIENT,),
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation=(
            "Cheeseman, I. C., and Bennett, W. E., The Effect of the Ground on a Helicopter Rotor"
            " in Forward Flight, ARC R&M 3021, written 1955, issued 1957"
        ),
        equation="hover limit; Eq. 1 of Carter, Bouchard and Quinn 2021",
        bibtex=("cheeseman1955",),
        doubts=(
            (
                "Carter et al. print 1/16z^2 where 1/(16 z_hat^2) is meant, and leave 'in Forward"
                " Flight' out of the title."
            ),
            (
                "The coefficient is Danjun et al. 2015 (10.1109/ChiCC.2015.7260521); a thesis that"
                " cites it confirms its role. The value 8.6 often quoted is from memory and"
                " unverified, and is not used here."
            ),
            (
                "The equivalent radius 2.5 R of Nobahari and Sharifi 2014"
                " (10.1016/j.engappai.2014.03.004) was read in a secondary transcription only."
            ),
        ),
    ),
    checks=(
        Check(x=1.0, expected=1.066667, quoted_by="golden value, exact from the formula"),
        Check(x=0.5, expected=1.333333, quoted_by="golden value, exact from the formula"),
        Check(x=2.0, expected=1.015873, quoted_by="golden value, exact from the formula"),
        Check(
            x=1.0,
            expected=1.641,
            arguments={"k": 6.25},
            tolerance=5e-4,
            quoted_by="Nobahari and Sharifi's R_eq = 2.5 R, secondary transcription",
        ),
        Check(x=2.0, expected=1.108, arguments={"k": 6.25}, tolerance=5e-4, quoted_by="the same"),
        Check(x=3.0, expected=1.045, arguments={"k": 6.25}, tolerance=5e-4, quoted_by="the same"),
    ),
    notes=__doc__ or "",
)


CONSTANT_POWER = variant(
    MODEL,
    exponent=2.0 / 3.0,
    name="cheeseman_bennett_constant_power",
    title="Cheeseman-Bennett, constant power",
    formula=r"\frac{L}{L_\infty} = \left(1 - \frac{k}{16 \hat{z}^2}\right)^{-2/3}",
    rotors="one",
    source=Source(
        citation=(
            "Own derivation from momentum theory and the image of Cheeseman and Bennett (ARC R&M"
            " 3021)"
        ),
        bibtex=("cheeseman1955",),
        doubts=("Not published in this form; derived here.",),
    ),
    checks=(Check(x=0.5, expected=1.211414, quoted_by="(4/3)^(2/3), own arithmetic"),),
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
)


THEORY = variant(
    MODEL,
    held={"k": 1.0},
    name="cheeseman_bennett_fixed",
    title="Cheeseman-Bennett, theory",
    formula=r"\frac{L}{L_\infty} = \frac{1}{1 - 1 / (16 \hat{z}^2)}",
    source=Source(
        citation=MODEL.source.citation,
        equation=MODEL.source.equation,
        bibtex=MODEL.source.bibtex,
        doubts=("Carter et al. print 1/16z^2 where 1/(16 z_hat^2) is meant.",),
    ),
    checks=(
        Check(x=1.0, expected=1.066667, quoted_by="golden value, exact from the formula"),
        Check(x=3.0, expected=1.0070, tolerance=5e-5, quoted_by="own table of the formula"),
    ),
    notes="""\
Ground: Cheeseman and Bennett as they published it, nothing free.

    L / L_inf = 1 / (1 - 1 / (16 z_hat^2))

The theory curve, which a fit of `cheeseman_bennett` has to beat; the paper calls it "classic
helicopter theory". Convention, approximation and refusal are those of `cheeseman_bennett` with k =
1. The pole is at z_hat = 0.25, and below z_hat = 0.5 the theory is not reliable.
""",
)
