"""Stage flow: downwash, mean fields and topology of the wake."""

from __future__ import annotations

from nearlift.run.schema import Column, Product
from nearlift.run.stage import Stage

DOWNWASH = Product(
    file="downwash.parquet",
    # the ratio v / v_inf is called downwash already
    called="downwash_cuts",
    title="Downwash beneath the rotors",
    row="a cut beneath one rotor of a [piv] case, or beneath all that were measured (rotor = all)",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="boundary",
            kind="text",
            meaning="ground, ceiling, or none (the control and other free-air cases)",
        ),
        Column(
            name="z_hat",
            unit="1",
            meaning="rotor plane to boundary over rotor radius; inf in free air",
        ),
        Column(
            name="tilt_rad",
            unit="rad",
            meaning="positive where the vehicle's +x side is farther from the boundary",
        ),
        Column(
            name="rotor",
            kind="text",
            meaning="index of the rotor in the light sheet from 0, or all",
        ),
        Column(name="below_m", unit="m", meaning="distance of the cut below the rotor plane"),
        Column(name="half_span_m", unit="m", meaning="half the length of the cut"),
        Column(
            name="downwash_m_s", unit="m/s", meaning="mean velocity against thrust through the cut"
        ),
        Column(
            name="u_downwash_m_s",
            unit="m/s",
            meaning="its standard uncertainty, the parts that follow in quadrature",
        ),
        Column(
            name="u_noise_m_s",
            unit="m/s",
            meaning="part from the scatter of fields, correlation in time included",
        ),
        Column(
            name="u_mask_m_s", unit="m/s", meaning="part from stretches of the cut without vectors"
        ),
        Column(name="u_position_m_s", unit="m/s", meaning="part from the place of the cut"),
        Column(name="u_span_m_s", unit="m/s", meaning="part from the length of the cut"),
        Column(
            name="u_scale_m_s",
            unit="m/s",
            meaning="part from the velocity scale; it cancels in the reduction",
        ),
        Column(name="covered", unit="1", meaning="part of the cut that has vectors"),
        Column(name="n_fields", kind="integer", meaning="fields averaged"),
        Column(name="n_eff", unit="1", meaning="independent fields among them, for this cut"),
        Column(
            name="clearance_hat",
            unit="1",
            meaning="least distance from the cut to the boundary over rotor radius",
        ),
        Column(name="reduction", unit="1", meaning="1 - downwash over the control's"),
        Column(name="u_reduction", unit="1", meaning="its standard uncertainty"),
        Column(name="reduction_lo90", unit="1", meaning="lower end of its 90 % interval"),
        Column(name="reduction_hi90", unit="1", meaning="upper end of its 90 % interval"),
        Column(
            name="warnings",
            kind="text",
            meaning="space separated; why this is not the inflow at the disk, or not all of it",
        ),
    ),
)
DOWNWASH_PROFILE = Product(
    file="downwash_profile.parquet",
    title="Downwash along the cut",
    row="a node of the cut of one [piv] case; what was mirrored is there too, and marked",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="x_m",
            unit="m",
            meaning="place along the light sheet from midway between the rotors",
        ),
        Column(
            name="downwash_m_s",
            unit="m/s",
            meaning="mean velocity against thrust; nan where there is no vector",
        ),
        Column(
            name="u_downwash_m_s",
            unit="m/s",
            meaning="its standard error, correlation in time included",
        ),
        Column(
            name="mirrored",
            kind="integer",
            meaning="1 where the other half was measured and this is its reflection",
        ),
    ),
)
FLOW_FIELDS = Product(
    file="flow_fields.parquet",
    title="Mean velocity fields",
    row=(
        "a node of the mean field of one [piv] case, in vehicle axes (y along thrust from the rotor"
        " plane)"
    ),
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="x_m", unit="m", meaning="along the light sheet from midway between the rotors"
        ),
        Column(name="y_m", unit="m", meaning="along thrust from the rotor plane"),
        Column(
            name="z_m",
            unit="m",
            meaning=(
                "distance to the boundary along its normal; inf in free air, negative behind it"
            ),
        ),
        Column(
            name="vx_m_s", unit="m/s", meaning="mean velocity along x; nan where there is no vector"
        ),
        Column(
            name="vy_m_s",
            unit="m/s",
            meaning="mean velocity along y (downwash is -vy); nan where there is no vector",
        ),
        Column(
            name="u_vx_m_s",
            unit="m/s",
            meaning="standard error of vx_m_s, correlation in time included",
        ),
        Column(
            name="u_vy_m_s",
            unit="m/s",
            meaning="standard error of vy_m_s, correlation in time included",
        ),
        Column(name="sd_vx_m_s", unit="m/s", meaning="standard deviation of one field's vx"),
        Column(name="sd_vy_m_s", unit="m/s", meaning="standard deviation of one field's vy"),
        Column(name="count", kind="integer", meaning="fields with a vector there"),
        Column(name="stagnant", kind="integer", meaning="1 in the stagnation zone"),
        Column(
            name="mirrored",
            kind="integer",
            meaning="1 where the other half was measured and this is its reflection",
        ),
    ),
)
FLOW_TOPOLOGY = Product(
    file="flow_topology.parquet",
    title="Topology of the wake near the ground",
    row="a number of one ground case of [piv]",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(name="z_hat", unit="1", meaning="rotor plane to boundary over rotor radius"),
        Column(
            name="tilt_rad",
            unit="rad",
            meaning="positive where the vehicle's +x side is farther from the boundary",
        ),
        Column(
            name="quantity", kind="text", meaning="which number; see the page of the flow stage"
        ),
        Column(name="value", meaning="its value in the mean field, in the unit that its name says"),
        Column(name="u", meaning="standard deviation over resampled mean fields"),
        Column(name="lo90", meaning="5 % quantile over resampled mean fields"),
        Column(name="hi90", meaning="95 % quantile over resampled mean fields"),
        Column(
            name="agreement",
            unit="1",
            meaning=(
                "share of resampled mean fields that give the same whole number; nan for what is no"
                " count"
            ),
        ),
    ),
)
FLOW = Product(
    file="flow.json", title="What was read and averaged of each velocity field", row="case"
)
FLOW_PRODUCTS = (DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW_TOPOLOGY, FLOW)
STAGE = Stage(
    name="flow",
    summary="velocity grids to downwash and topology",
    help="Only where the manifest has [piv].",
    writes=FLOW_PRODUCTS,
    sections=("name", "vehicle", "rig", "piv"),
    piv=True,
    where="piv",
)
