"""Effects on the ratio: each maps L / L_inf to L / L_inf."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null, uniform


def near_wall_saturation(ratio: Any, /, *, z_hat: Any, gap_hat2: Any, saturation_power: Any) -> Any:
    """Ratio: the gain stops growing close to the boundary.

        ratio -> 1 + (ratio - 1) (1 + gap_hat2 / z_hat^2)^(-saturation_power)

    Mechanism: in inviscid theory the inflow grows without limit. In a gap no wider than a few
    boundary layers viscosity and turning losses limit it. gap_hat2 is the square of a gap z_v, over
    rotor radius, below which the gain saturates.

    Convention: gap_hat2 >= 0; gains shrink. The form is the ratio's own version of z_hat ->
    sqrt(z_hat^2 + z_v^2). The two are identical with the power 1 for a gain that scales as z_hat^-2
    (far away). With the power 1/2 they are for z_hat^-1 (close to a ceiling). The power 0.68
    between them gives 1.60 in place of 2.337 at z_hat = 0.1 with z_v = 0.15, as that height form
    does.

    Size on a Crazyflie: z_v up to 0.3. Boundary layers (0.65 mm at z_hat = 0.1) displace 3 to 10 %
    of the gap. Viscosity alone is therefore a modest correction down to z_hat = 0.1.

    Confounded with height_offset (0.97 under a ceiling), held_quantity (0.99), image_strength.
    """
    # a sidewall's tip gap may be 0 on record
    distance = np.maximum(z_hat, 1e-6)
    return ratio + (ratio - 1.0) * (
        (1.0 + gap_hat2 / np.square(distance)) ** (-saturation_power) - 1.0
    )


def viscous_layer(ratio: Any, /, *, z_hat: Any, viscous_share: Any, layer_hat: Any) -> Any:
    """Ratio: viscous layers of a thickness of their own hold the gain back.

        ratio -> 1 + (ratio - 1) (1 - viscous_share exp(-z_hat / layer_hat))

    Mechanism: as `near_wall_saturation`, but cut off: beyond a few layers the flow is inviscid, as
    an impinging jet is outside its wall layer.

    Convention: viscous_share >= 0 is the share of the gain that is lost at contact.

    Size on a Crazyflie: a layer of 0.2 radii takes up to 60 % of the viscous share at z_hat = 0.1.
    At 1 it takes less than 1 % of it.

    Confounded with height_offset, held_quantity, image_strength.
    """
    return ratio - (ratio - 1.0) * viscous_share * np.exp(-np.asarray(z_hat) / layer_hat)


NEAR_WALL_SATURATION = Effect(
    "near_wall_saturation", "Near-wall saturation",
    r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 + \hat{z}_v^2 /"
    r" \hat{z}^2\right)^{-q}",
    near_wall_saturation, form="soft", acts_on="ratio", inflow=True, belongs_to="vehicle",
    varies_with="z_hat", needs=("z_hat",),
    mechanism="viscosity and turning losses in a narrow gap hold the gain back",
    separated_by="stations below z_hat = 0.3, a rotor of another size, and logged rpm and power",
    parameters=(
        Parameter("gap_hat2", "1", 0.0, (0.0, 0.25), Prior(distribution="halfnorm", scale=0.03),
            "square of the gap, in rotor radii, below which the gain saturates; larger loses"
            " more of the gain, 0 loses none", size_unit="square rotor radii"),
        Parameter("saturation_power", "1", 0.68, (0.3, 1.5), uniform(0.3, 1.2),
            "how the gain is held back well inside the gap: 1 for a gain that scales as z_hat^-2,"
            " 1/2 for z_hat^-1",
            grid=(0.5, 0.68, 1.0)),
    ),
    source=Source(
        "Physics of the bench; Carter, Bouchard and Quinn 2021 put the ceiling model's excess"
        " close by down to viscosity",
        bibtex=("carter2021",),
        doubts=(
            ("The held quantity explains the same shortfall without viscosity: at constant rpm"
             " gamma^n saturates near 2.1 to 2.4."),
            ("That it acts on the ratio rather than on the height is a choice; the two agree to"
             " the form's own uncertainty."),
        ),
    ),
    checks=(
        null(2.337117, z_hat=0.1),
        Check(2.337117, 1.60, {"z_hat": 0.1, "gap_hat2": 0.0225},
            "z_v = 0.15 turns 2.337 into 1.60 at z_hat = 0.1", tolerance=2e-3),
        Check(1.4, 1.2, {"z_hat": 0.5, "gap_hat2": 0.25, "saturation_power": 1.0},
            "by hand: half the gain at z_hat = z_v"),
    ),
).or_form(
    "cut-off",
    r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 - s \,"
    r" e^{-\hat{z} / \hat{\delta}}\right)",
    viscous_layer,
    parameters=(
        Parameter("viscous_share", "1", 0.0, (0.0, 3.0), Prior(distribution="halfnorm", scale=0.2),
            "share of the gain that viscous layers take at contact; larger loses more of the gain",
            size_unit="fraction of gain, at contact"),
        Parameter("layer_hat", "1", 0.2, (0.03, 1.5),
            Prior(distribution="lognorm", shape=(0.7,), scale=0.2),
            "thickness of these layers, in rotor radii", grid=(0.1, 0.2, 0.5)),
    ),
    source=Source(
        "Physics of the bench: boundary layers of one thickness on disk and wall",
        doubts=("No measurement distinguishes the two forms on a small rotor.",),
    ),
    checks=(
        null(2.337117, z_hat=0.1),
        Check(1.5, 1.4080301, {"z_hat": 0.2, "viscous_share": 0.5},
            "by hand: half of 1/e of the gain lost at one thickness"),
    ),
)  # fmt: skip


def held_quantity(ratio: Any, /, *, held_exponent: Any) -> Any:
    """Ratio: the held quantity.

        ratio -> ratio^held_exponent

    Mechanism: every published ratio is at constant something. Near a boundary a rotor's load
    changes, and with it rpm, current and the voltage at the motor. A trial at constant throttle
    holds none of them.

    Convention: 1 leaves the model as it is; 2/3 turns a ratio of powers into one of thrusts at
    constant power. About 0.60 to 0.82 is a small rotor at constant rpm (blade-element momentum
    theory), falling further as the gain grows. Below 1, gains and losses shrink.

    Size on a Crazyflie: under a ceiling at z_hat = 0.2 gamma is 1.516, against 1.28 to 1.33 at
    constant rpm.

    Confounded with K_b (correlation 0.99 to 1.00), alpha (0.997 with the datum), height_offset,
    near_wall_saturation, image_strength. Lift alone cannot separate them.
    """
    return np.power(np.where(np.asarray(ratio) > 0, ratio, np.nan), held_exponent)


HELD_QUANTITY = Effect(
    "held_quantity", "Held quantity", r"\frac{L}{L_\infty} \to \left(\frac{L}{L_\infty}\right)^{n}",
    held_quantity, acts_on="ratio", belongs_to="vehicle", varies_with="z_hat",
    log_next_time=("rpm", "power"),
    mechanism="the trial holds throttle constant, the model power, rpm or thrust",
    separated_by="logged rpm and power",
    parameters=(
        Parameter("held_exponent", "1", 1.0, (0.3, 1.7), normal(1.0, 0.25),
            "exponent of the ratio; 1 the model as it is, 2/3 constant power, below 1 gains"
            " shrink", size_unit="exponent of the lift ratio"),
    ),
    source=Source(
        "Blade-element momentum theory; Carter, Bouchard and Quinn 2021 scale their models by the"
        " powers 0.6 to 1.4",
        bibtex=("carter2021",),
        doubts=(
            ("The exponent at constant throttle is known only between limits, and falls as the"
             " gain grows."),
        ),
    ),
    checks=(
        null(2.337117),
        Check(2.337117, 1.761, {"held_exponent": 2 / 3}, "gamma^(2/3) at z_hat = 0.1",
            tolerance=5e-4),
        Check(1.112372, 1.074, {"held_exponent": 2 / 3}, "gamma^(2/3) at z_hat = 0.5",
            tolerance=5e-4),
    ),
)  # fmt: skip


#: Height, in rotor radii, below which the power law is held: the damming must end somewhere.
STAGNATION_FLOOR_HAT = 0.2


def airframe_stagnation(
    ratio: Any, /, *, z_hat: Any, stagnation: Any, stagnation_power: Any
) -> Any:
    """Ratio: pressure on the underside of the airframe.

        ratio -> ratio + stagnation z_hat^(-stagnation_power)

    Mechanism: close to the ground the wakes cannot leave freely. Air dammed up beneath body,
    battery and arms presses on them, or the wall jets' speed sucks them down.

    Convention: stagnation > 0 gains lift (dammed up), < 0 loses it (suckdown); it is the share of
    L_inf one radius above the ground. It is the same at every throttle, since pressure and lift
    both scale as the square of the jet's speed.

    Size on a Crazyflie: 9e-4 m^2 of body at the disk loading of 40 Pa bound it by 36 mN, 14 % of
    the weight. Realistic are 0 to 3 % where trials begin. Published suckdown forms are powers
    z_hat^-1 to z_hat^-3; closer than 0.2 radii none was measured, and the form is held there.

    Confounded with image_strength (0.999 above ground), height_offset, plate_edge and K_b.
    """
    return ratio + stagnation * np.maximum(z_hat, STAGNATION_FLOOR_HAT) ** -np.asarray(
        stagnation_power, dtype=float
    )


def stagnation_decay(ratio: Any, /, *, z_hat: Any, stagnation: Any, stagnation_length: Any) -> Any:
    """Ratio: pressure on the underside of the airframe, decaying over a length.

        ratio -> ratio + stagnation exp((1 - z_hat) / stagnation_length)

    Mechanism: as `airframe_stagnation`; a periodic or confined pressure field decays exponentially
    away from the wall (Laplace's equation), over a length given by the frame.

    Convention: stagnation > 0 gains lift, < 0 loses it; it is the share of L_inf one radius above
    the ground. stagnation_length is in rotor radii.

    Size on a Crazyflie: 0 to 3 % where trials begin, as in the other form.

    Confounded with image_strength, height_offset, plate_edge and K_b.
    """
    return ratio + stagnation * np.exp((1.0 - np.asarray(z_hat)) / stagnation_length)


AIRFRAME_STAGNATION = Effect(
    "airframe_stagnation", "Airframe pressure",
    r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, \hat{z}^{-m}", airframe_stagnation,
    form="power law", acts_on="ratio", belongs_to="vehicle", varies_with="z_hat",
    boundaries=("ground",), needs=("z_hat",),
    mechanism=(
        "air dammed up between ground and airframe presses on its underside, or wall jets suck it"
        " down"
    ),
    separated_by="a bare frame against one with deck and battery, and stations below z_hat = 1",
    parameters=(
        Parameter("stagnation", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.02),
            "lift from the airframe's underside one radius up, as a share of L_inf; positive"
            " gains lift, negative is suckdown", size_unit="fraction of lift, at one radius"),
        Parameter("stagnation_power", "1", 2.0, (1.0, 4.0), uniform(1.0, 3.0),
            "how fast that pressure falls with height: the power of z_hat, negated",
            grid=(1.0, 2.0, 3.0)),
    ),
    source=Source(
        "Physics of the bench; arXiv 2309.10919 distinguishes ground, suckdown and fountain",
        doubts=(
            ("No closed form for a small quadrotor is known; the bound is disk loading times"
             " planform."),
        ),
    ),
    checks=(
        null(1.1586, z_hat=1.0),
        Check(1.0, 1.0125, {"z_hat": 2.0, "stagnation": 0.05}, "by hand: 0.05 / 2^2"),
        Check(1.0, 0.97, {"z_hat": 1.0, "stagnation": -0.03, "stagnation_power": 3.0},
            "by hand: at z = r its size"),
    ),
).or_form(
    "exponential",
    r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, e^{(1 - \hat{z}) / \hat{\ell}}",
    stagnation_decay,
    parameters=(
        Parameter("stagnation", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.02),
            "lift from the airframe's underside one radius up, as a share of L_inf; positive"
            " gains lift, negative is suckdown", size_unit="fraction of lift, at one radius"),
        Parameter("stagnation_length", "1", 0.7, (0.2, 3.0),
            Prior(distribution="lognorm", shape=(0.6,), scale=0.7),
            "height, in rotor radii, over which that pressure falls to 1/e", grid=(0.4, 0.7, 1.3)),
    ),
    source=Source(
        "Physics of the bench: a disturbance of a potential flow decays exponentially from a wall",
        doubts=("No closed form for a small quadrotor is known.",),
    ),
    checks=(
        null(1.1586, z_hat=1.0),
        Check(1.0, 1.0183940, {"z_hat": 1.7, "stagnation": 0.05},
            "by hand: 1/e of 0.05 one length above a radius"),
    ),
)  # fmt: skip


#: Standard width of the bump in ln z_hat: half its height is left at 0.55 and 1.8 times the height
#: of its peak.
FOUNTAIN_WIDTH = 0.5


def fountain_shape(
    ratio: Any, /, *, z_hat: Any, spacing_hat: Any, fountain: Any, fountain_height: Any
) -> Any:
    """Ratio: a fountain with a length of its own.

        ratio -> ratio + fountain exp(-(ln(z_hat / (fountain_height spacing_hat)))^2 / (2 w^2))
        w = 0.5

    Mechanism: the wall jets of neighbouring rotors collide and rise between them. The fountain
    reaches the body, or is drawn in again by the rotors, over a range of heights. The spacing of
    the axes sets that range; the models' fountain term has one fixed shape.

    Convention: fountain is a share of L_inf. It is > 0 where lift is gained at its peak (it pushes
    on the body), < 0 where lift is lost (drawn in again). None at contact, where no room is left
    for it, and none far away. An isolated rotor has no fountain and no `spacing_hat`.

    Size on a Crazyflie: 2 to 4 % of lift between z_hat = 1 and 3, of which K_b takes what has its
    own shape.

    Approximation: empirical, a bump in the logarithm of height with fixed width.

    Confounded with K_b, with plate_edge and height_scale where the nearest station is beyond z_hat
    = 2.
    """
    off_peak = np.log(np.maximum(z_hat, 1e-6) / (fountain_height * spacing_hat))
    return ratio + fountain * np.exp(-0.5 * np.square(off_peak / FOUNTAIN_WIDTH))


def fountain_jet(
    ratio: Any, /, *, z_hat: Any, spacing_hat: Any, fountain: Any, fountain_height: Any
) -> Any:
    """Ratio: a fountain with a length of its own, which decays as a far field does.

        ratio -> ratio + fountain u (3 / (2 + u^2))^(3/2),   u = z_hat / (fountain_height
        spacing_hat)

    Mechanism: as `fountain_shape`. The shape is that of the fountain term of Sanchez-Cuevas, with
    its length free: proportional to height close by, to its inverse square far away.

    Convention: fountain > 0 gains lift at its peak, < 0 loses it, as a share of L_inf.

    Size on a Crazyflie: 2 to 4 % of lift between z_hat = 1 and 3.

    Confounded with K_b, exactly where fountain_height is 0.5; with plate_edge and height_scale.
    """
    # in free air there is none
    u = np.minimum(np.asarray(z_hat) / (fountain_height * spacing_hat), 1e9)
    return ratio + fountain * u * (3.0 / (2.0 + np.square(u))) ** 1.5


FOUNTAIN_SHAPE = Effect(
    "fountain_shape", "Fountain length",
    r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, \exp\left[-\frac{1}{2 w^2} \ln^2"
    r" \frac{\hat{z}}{\eta \hat{d}}\right]",
    fountain_shape, form="bump", acts_on="ratio", belongs_to="vehicle", varies_with="z_hat",
    boundaries=("ground",), needs=("z_hat", "spacing_hat"),
    mechanism=(
        "the fountain between rotors reaches body or disks over a range of heights of its own"
    ),
    separated_by=(
        "stations every half radius between 1 and 4, a pair of rotors instead of four, or the body"
        " removed"
    ),
    parameters=(
        Parameter("fountain", "1", 0.0, (-0.2, 0.2), normal(0.0, 0.03),
            "lift from the fountain at its strongest, beyond the model's, as a share of L_inf;"
            " positive gains lift", size_unit="fraction of lift, at its strongest"),
        Parameter("fountain_height", "1", 0.55, (0.15, 2.0),
            Prior(distribution="lognorm", shape=(0.5,), scale=0.55),
            "height where it is strongest, over the distance of adjacent rotor axes",
            grid=(0.35, 0.55, 0.85, 1.3)),
    ),
    source=Source(
        "Dekker et al., AIAA J. 60(7), 2022: wall jets of neighbouring rotors collide, rise and"
        " may be drawn in again",
        doubts=(
            "That work shows the flow; the bump's form and width are own choices.",
            "The fountain switches sides at some 5 Hz; a record of 10 s averages that out.",
        ),
    ),
    checks=(
        null(1.1, z_hat=1.5, spacing_hat=65 / 23),
        Check(1.1, 1.12,
            {"z_hat": 1.5, "spacing_hat": 3.0, "fountain": 0.02, "fountain_height": 0.5},
            "by hand: at the peak"),
        Check(1.0, 1.0121306,
            {"z_hat": 1.5 * 1.6487213, "spacing_hat": 3.0, "fountain": 0.02,
             "fountain_height": 0.5},
            "by hand: 0.02 exp(-1/2) one width above"),
    ),
).or_form(
    "far field",
    r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, u \left(\frac{3}{2 + u^2}\right)^{3/2},"
    r" \quad u = \frac{\hat{z}}{\eta \hat{d}}",
    fountain_jet,
    source=Source(
        "Fountain term of Sanchez-Cuevas, Heredia and Ollero 2017 with its length free",
        bibtex=("sanchezcuevas2017",),
        doubts=("Its length is half the rotors' distance there; another is an own choice.",),
    ),
    checks=(
        null(1.1, z_hat=1.5, spacing_hat=65 / 23),
        Check(1.1, 1.12,
            {"z_hat": 1.5, "spacing_hat": 3.0, "fountain": 0.02, "fountain_height": 0.5},
            "by hand: at the peak"),
        Check(1.0, 1.0141421,
            {"z_hat": 3.0, "spacing_hat": 3.0, "fountain": 0.02, "fountain_height": 0.5},
            "by hand: 0.02 x 2 / 2^(3/2) at twice its height"),
    ),
)  # fmt: skip


def image_strength(ratio: Any, /, *, strength: Any) -> Any:
    """Ratio: a free coefficient on the images.

        ratio = 1 / (1 - s)  ->  1 / (1 - strength s)

    with s = 1 - 1 / ratio, the share of inflow that is cancelled.

    Mechanism: a rotor is no point source of uniform inflow and the ground no perfect mirror
    (roughness, boundary layer, load distribution). The images cancel more or less of the inflow
    than in theory.

    Convention: strength > 1 gains more, 1 is the model. Where a model has a free fountain K_b and
    images, K_b takes up the fountain's part of the scaling. The remainder is a coefficient on the
    images alone. Above ground only: models of a ceiling and a sidewall have no images.

    Refusal: nan where nothing of the inflow would be left.

    Size: on the same open data a coefficient of 1.1 with the datum fixed and 2.9 with it free. It
    is within 0.2 of 1 on a bench with known zero and exponent.

    Confounded with airframe_stagnation (0.999 above ground), height_offset, held_quantity,
    plate_edge; absorbed exactly by the coefficient of a model that has one on its only image.
    """
    # the same as 1 / (1 - strength (1 - 1 / ratio)), and exact at strength 1
    left = 1.0 - (strength - 1.0) * (ratio - 1.0)
    return ratio / np.where(left > 0, left, np.nan)


IMAGE_STRENGTH = Effect(
    "image_strength", "Image strength", r"\frac{1}{1 - s} \to \frac{1}{1 - \kappa s}",
    image_strength, acts_on="ratio", inflow=True, belongs_to="vehicle", varies_with="z_hat",
    boundaries=("ground",),
    mechanism="images cancel more or less of the inflow than point sources in potential flow do",
    separated_by="stations below z_hat = 1 and beyond 5",
    parameters=(
        Parameter("strength", "1", 1.0, (0.3, 1.7), normal(1.0, 0.2),
            "share of inflow cancelled over the model's; above 1 gains more lift near the"
            " boundary", size_unit="fraction of the model's images"),
    ),
    source=Source(
        "Coefficient on Cheeseman and Bennett's image as in Danjun and Li 2015, and as fitted to"
        " open data",
        bibtex=("cheeseman1955",),
        doubts=(
            "The role is confirmed by secondary sources; their values were not.",
            "A rough ground gives more lift than a smooth one (10.1177/17568293251350056).",
        ),
    ),
    checks=(
        null(1.1586),
        Check(16 / 15, 1 / (1 - 1.5 / 16), {"strength": 1.5},
            "by hand: Cheeseman and Bennett at z_hat = 1 with 1.5 images"),
        Check(0.8, 1 / (1 + 0.5 * 0.25), {"strength": 0.5}, "by hand: a loss, s = -1/4"),
    ),
)  # fmt: skip


def plate_edge(ratio: Any, /, *, z_hat: Any, edge_share: Any, edge_width_hat: Any) -> Any:
    """Ratio: the boundary ends.

        ratio -> 1 + (ratio - 1) (1 - edge_share exp(-edge_width_hat^2 / z_hat^2))

    Mechanism: a plate of half-width W mirrors only the part of the wake that it catches. The wake
    widens with the distance that it has travelled. Beyond z = W / c, with c between 0.5 and 3, it
    flows past the edge. The effect then fades sooner than above a plane without end.

    Convention: edge_width_hat = W / (c r) is the distance, in rotor radii, at which 1/e of the loss
    is reached. edge_share is the share of the gain (a sidewall's loss) that is lost far beyond it.
    It is 1 where nothing lies behind the plate, and less where a floor goes on below its edge. It
    is 0 for a plane without end. The range goes beyond 1 because the form is approximate. A plate
    narrower than the vehicle is no ground: edge_width_hat is at least 2.

    Size on a Crazyflie, for a plate beyond four diagonals (W = 8 r, c = 2): 0.4 % of the gain is
    lost at z_hat = 1.7, and 17 % at 3. The gain at 3 is 6 % of lift.

    Confounded with K_b, height_offset, image_strength above ground; with fountain_shape where
    stations begin at z_hat = 2.
    """
    # at contact the plate is all that the rotor sees, in free air (z_hat infinite) there is none
    return ratio - (ratio - 1.0) * edge_share * np.exp(
        -np.square(edge_width_hat / np.maximum(z_hat, 1e-6))
    )


def plate_view(ratio: Any, /, *, z_hat: Any, edge_share: Any, edge_width_hat: Any) -> Any:
    """Ratio: the boundary ends, and mirrors the share of the rotor's view that it fills.

        ratio -> 1 + (ratio - 1) (1 - edge_share / (1 + edge_width_hat^2 / z_hat^2))

    Mechanism: a coaxial disk of radius W fills 1 / (1 + z^2 / W^2) of the view from a height z
    (Lambert's view factor). What it does not fill mirrors nothing.

    Convention: edge_width_hat is the distance, in rotor radii, at which half of the loss is
    reached. edge_share is the share of the gain that is lost far beyond it.

    Size on a Crazyflie: a plate of W = 8 r loses 4 % of the gain at z_hat = 1.7, 12 % at 3.

    Confounded with K_b, height_offset, image_strength above ground.
    """
    return ratio - (ratio - 1.0) * edge_share / (
        1.0 + np.square(edge_width_hat / np.maximum(z_hat, 1e-6))
    )


PLATE_EDGE = Effect(
    "plate_edge", "Plate edge",
    r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 - s \, e^{-\hat{W}^2"
    r" / \hat{z}^2}\right)",
    plate_edge, form="Gaussian", acts_on="ratio", inflow=True, varies_with="z_hat",
    needs=("z_hat",),
    mechanism="the plate ends, and mirrors only what it catches of the wake",
    separated_by="the plate moved sideways, a larger one, or stations between 3 and 10",
    parameters=(
        Parameter("edge_share", "1", 0.0, (0.0, 1.5), Prior(distribution="halfnorm", scale=0.25),
            "share of the gain lost far beyond the edge; 1 where nothing lies behind the plate,"
            " 0 is a plane without end", size_unit="fraction of gain"),
        Parameter("edge_width_hat", "1", 4.5, (2.0, 30.0),
            Prior(distribution="lognorm", shape=(0.7,), scale=5.0),
            "distance, in rotor radii, at which the wake has outgrown the plate: its half-width"
            " over the wake's spread",
            grid=(2.5, 4.5, 8.0)),
    ),
    source=Source(
        "Finite plates under a rotor: University of Dayton MSc thesis, 2020; physics of the bench,"
        " E22",
        doubts=(
            "The wake's spread c is known to a factor of six; only W / c can be found.",
        ),
    ),
    checks=(
        null(1.1, z_hat=2.0),
        Check(1.1, 1.0632121, {"z_hat": 5.0, "edge_share": 1.0, "edge_width_hat": 5.0},
            "by hand: 1/e of the gain lost at W"),
        Check(1.05, 1.0495421, {"z_hat": 2.5, "edge_share": 0.5, "edge_width_hat": 5.0},
            "by hand: half of e^-4 of it at W / 2"),
    ),
).or_form(
    "view factor",
    r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 - \frac{s}{1 +"
    r" \hat{W}^2 / \hat{z}^2}\right)",
    plate_view,
    source=Source(
        "View factor of a coaxial disk (Lambert's cosine law)",
        doubts=("A wake is no light: it bends along the plate.",),
    ),
    checks=(
        null(1.1, z_hat=2.0),
        Check(1.1, 1.05, {"z_hat": 5.0, "edge_share": 1.0, "edge_width_hat": 5.0},
            "by hand: half the gain lost at W"),
    ),
)  # fmt: skip


def tilt(
    ratio: Any,
    /,
    *,
    z_hat: Any,
    tilt_rad: Any,
    tilt_first: Any,
    tilt_second: Any,
    tilt_decay: Any,
    tilt_zero: Any,
    tilt_lean: Any,
) -> Any:
    """Ratio: plane or vehicle is tilted.

        ratio -> (1 + (ratio - 1) (1 + (tilt_first t + tilt_second t^2) z_hat^-tilt_decay))
        (1 - tilt_lean t^2 / 2),   t = tilt_rad + tilt_zero

    Mechanism: three of them. Tilted about another point than its centre, the vehicle comes nearer
    or goes farther: first order, gain (1 - 2 x_0 t / z). Tilted about its centre, rotors on one
    side come nearer by x_i t and gain more than the others lose. This is of second order: 3 <x_i^2>
    t^2 / z^2 of a gain that scales as z^-2. Where the cell does not tilt, a tilted force acts on it
    by its cosine, at every distance.

    Convention: t > 0 as the schedule has it; tilt_first changes sign with it, tilt_second > 0 gains
    lift on either side. tilt_decay is 0 where a tilt acts in proportion to the gain (turned wakes
    and wall jets), 2 for the rotors' distances. tilt_lean is 1 where the vehicle tilts and the cell
    does not, 0 where the plate tilts. In free air (a blank tilt allowed) nothing changes.

    Size on a Crazyflie: 1 degree is 0.8 mm across 90 mm. By the sum over images at z_hat = 1, the
    second order is 0.03 % of lift at 1.5 degrees and 0.35 % at 5. A centre 10 mm off gives 0.1 % of
    lift per degree there; the cosine takes 0.4 % at 5 degrees.

    Confounded with height_offset and K_b at a constant tilt, and so by its zero. If the tilt is
    known only to a degree, the uncertainty of a coefficient is larger than that of its fit.
    """
    angle = np.where(np.isinf(z_hat), 0.0, tilt_rad + tilt_zero)
    change = (tilt_first * angle + tilt_second * np.square(angle)) * np.maximum(z_hat, 1e-6) ** (
        -tilt_decay
    )
    return (ratio + (ratio - 1.0) * change) * (1.0 - 0.5 * tilt_lean * np.square(angle))


TILT = Effect(
    "tilt", "Tilt",
    r"\frac{L}{L_\infty} \to \left\{1 + \left(\frac{L}{L_\infty} - 1\right) \left[1 + (t_1 t + t_2"
    r" t^2) \hat{z}^{-m}\right]\right\} \left(1 - \tfrac{c}{2} t^2\right)",
    tilt, acts_on="ratio", varies_with="tilt_rad", needs=("z_hat", "tilt_rad"),
    log_next_time=("tilt",),
    mechanism="tilt puts rotors, or the whole vehicle, at other distances than recorded",
    separated_by="repeats at both signs",
    parameters=(
        Parameter("tilt_first", "1/rad", 0.0, (-10.0, 10.0), normal(0.0, 1.5),
            "relative change of the gain per radian of tilt; positive where positive tilt gains"
            " lift"),
        Parameter("tilt_second", "1/rad^2", 0.0, (-100.0, 100.0), normal(0.0, 10.0),
            "relative change of the gain per square radian of tilt; positive where tilt to"
            " either side gains lift; 3.5 to 5 on a Crazyflie"),
        Parameter("tilt_lean", "1", 0.0, (-4.0, 6.0), normal(0.0, 1.0),
            "share of the cosine's loss of a tilted force that the cell reads, at every"
            " distance: 1 where the cell is fixed", size_unit="fraction of the cosine's loss"),
        Parameter("tilt_decay", "1", 2.0, (0.0, 4.0), uniform(0.0, 4.0),
            "power of distance with which a tilt's share of the gain falls off: 0 turned wakes, 2"
            " distances of the rotors",
            grid=(0.0, 2.0)),
        Parameter("tilt_zero", "rad", 0.0, (-0.1, 0.1), normal(0.0, 0.02),
            "true tilt where the log reads 0: an inclinometer on the plate does not measure the"
            " rotors' angle to it",
            grid=(0.0,)),
    ),
    source=Source(
        "Own expansion of the per-rotor images of Sanchez-Cuevas, Heredia and Ollero 2017"
        " (10.1155/2017/1823056)",
        bibtex=("sanchezcuevas2017",),
        doubts=(
            ("The expansion is for rotors whose heights differ by much less than their distance;"
             " farther apart they gain more."),
            "A tilted fountain and turned vortices have no known form.",
        ),
    ),
    checks=(
        null(1.1, z_hat=1.0, tilt_rad=0.1),
        Check(1.1, 1.1025, {"z_hat": 2.0, "tilt_rad": 0.1, "tilt_second": 10.0},
            "by hand: 0.1 (10 x 0.01) / 4"),
        Check(1.1, 1.095, {"z_hat": 1.0, "tilt_rad": -0.1, "tilt_first": 0.5, "tilt_decay": 0.0},
            "by hand: 0.1 (0.5 x -0.1)"),
        Check(1.1, 1.1 * 0.995,
            {"z_hat": 1.0, "tilt_rad": 0.08, "tilt_zero": 0.02, "tilt_lean": 1.0},
            "by hand: cosine of 0.1 to second order"),
    ),
)  # fmt: skip


def reynolds(ratio: Any, /, *, throttle: Any, throttle_ref: Any, reynolds_slope: Any) -> Any:
    """Ratio: the relative effect depends on throttle.

        ratio -> 1 + (ratio - 1) (1 + reynolds_slope ln(throttle / throttle_ref))

    Mechanism: blades of 6 mm chord work at a Reynolds number near 13 000, where lift slope and
    losses change with speed. So do the viscous losses in the gap. The gain then differs by
    throttle.

    Convention: reynolds_slope > 0 where the gain grows with throttle; throttle_ref is the median of
    the campaign's throttles, at which the base model's coefficients hold. L_inf at each throttle is
    free, so lift far away is unaffected.

    Size on a Crazyflie: C_L rises by 10 % from 25 to 92 % throttle. In the *ratio* that is second
    order, 0 to 1 % of lift, so a slope of 0.05.

    Confounded with zero_offset, cell_nonlinearity and supply_sag, which also act differently at
    each throttle.
    """
    return ratio + (ratio - 1.0) * reynolds_slope * np.log(throttle / throttle_ref)


REYNOLDS = Effect(
    "reynolds", "Reynolds number",
    r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 + m \ln"
    r" \frac{\tau}{\tau_0}\right)",
    reynolds, acts_on="ratio", varies_with="throttle", needs=("throttle", "throttle_ref"),
    log_next_time=("rpm",),
    mechanism="the blades' Reynolds number, and with it the gain, changes with throttle",
    separated_by=(
        "logged rpm and supply, a motors-off sweep, and repeats at equal throttle from another"
        " supply"
    ),
    parameters=(
        Parameter("reynolds_slope", "1", 0.0, (-1.0, 1.0), normal(0.0, 0.1),
            "relative change of the gain per unit of ln throttle; positive where the gain grows"
            " with throttle", size_unit="fraction of gain, per unit of ln throttle"),
    ),
    source=Source(
        "Deters, Ananda and Selig 2014 (small propellers); Bitcraze's table of lift against"
        " throttle",
        doubts=(
            "Both speak of lift far away; that the ratio follows is an estimate.",
            "Throttle replaces rotor speed.",
        ),
    ),
    checks=(
        null(1.15, throttle=0.25, throttle_ref=0.625),
        Check(1.15, 1.165, {"throttle": 0.2718281828, "throttle_ref": 0.1, "reynolds_slope": 0.1},
            "by hand: a tenth more gain at e times the throttle"),
    ),
)  # fmt: skip


EFFECTS = (
    NEAR_WALL_SATURATION,
    HELD_QUANTITY,
    AIRFRAME_STAGNATION,
    FOUNTAIN_SHAPE,
    IMAGE_STRENGTH,
    PLATE_EDGE,
    TILT,
    REYNOLDS,
)
