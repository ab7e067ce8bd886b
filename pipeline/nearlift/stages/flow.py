"""Stage flow: downwash, mean fields and topology of the wake."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.run import tables
from nearlift.run.engine import Inputs, Job, Outcome, Stage
from nearlift.run.tables import Product, integer, real, text

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign
    from nearlift.campaign.piv import PivCase


DOWNWASH = Product(
    file="downwash.parquet",
    # the ratio v / v_inf is called downwash already
    called="downwash_cuts",
    title="Downwash beneath the rotors",
    row="a cut beneath one rotor of a [piv] case, or beneath all that were measured (rotor = all)",
    columns=(
        text("case", "name of the case in [piv]"),
        text("boundary", "ground, ceiling, or none (the control and other free-air cases)"),
        real("z_hat", "1", "rotor plane to boundary over rotor radius; inf in free air"),
        real(
            "tilt_rad", "rad", "positive where the vehicle's +x side is farther from the boundary"
        ),
        text("rotor", "index of the rotor in the light sheet from 0, or all"),
        real("below_m", "m", "distance of the cut below the rotor plane"),
        real("half_span_m", "m", "half the length of the cut"),
        real("downwash_m_s", "m/s", "mean velocity against thrust through the cut"),
        real(
            "u_downwash_m_s", "m/s", "its standard uncertainty, the parts that follow in quadrature"
        ),
        real("u_noise_m_s", "m/s", "part from the scatter of fields, correlation in time included"),
        real("u_mask_m_s", "m/s", "part from stretches of the cut without vectors"),
        real("u_position_m_s", "m/s", "part from the place of the cut"),
        real("u_span_m_s", "m/s", "part from the length of the cut"),
        real("u_scale_m_s", "m/s", "part from the velocity scale; it cancels in the reduction"),
        real("covered", "1", "part of the cut that has vectors"),
        integer("n_fields", "fields averaged"),
        real("n_eff", "1", "independent fields among them, for this cut"),
        real("clearance_hat", "1", "least distance from the cut to the boundary over rotor radius"),
        real("reduction", "1", "1 - downwash over the control's"),
        real("u_reduction", "1", "its standard uncertainty"),
        real("reduction_lo90", "1", "lower end of its 90 % interval"),
        real("reduction_hi90", "1", "upper end of its 90 % interval"),
        text(
            "warnings", "space separated; why this is not the inflow at the disk, or not all of it"
        ),
    ),
)
DOWNWASH_PROFILE = Product(
    file="downwash_profile.parquet",
    title="Downwash along the cut",
    row="a node of the cut of one [piv] case; what was mirrored is there too, and marked",
    columns=(
        text("case", "name of the case in [piv]"),
        real("x_m", "m", "place along the light sheet from midway between the rotors"),
        real("downwash_m_s", "m/s", "mean velocity against thrust; nan where there is no vector"),
        real("u_downwash_m_s", "m/s", "its standard error, correlation in time included"),
        integer("mirrored", "1 where the other half was measured and this is its reflection"),
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
        text("case", "name of the case in [piv]"),
        real("x_m", "m", "along the light sheet from midway between the rotors"),
        real("y_m", "m", "along thrust from the rotor plane"),
        real(
            "z_m",
            "m",
            "distance to the boundary along its normal; inf in free air, negative behind it",
        ),
        real("vx_m_s", "m/s", "mean velocity along x; nan where there is no vector"),
        real(
            "vy_m_s", "m/s", "mean velocity along y (downwash is -vy); nan where there is no vector"
        ),
        real("u_vx_m_s", "m/s", "standard error of vx_m_s, correlation in time included"),
        real("u_vy_m_s", "m/s", "standard error of vy_m_s, correlation in time included"),
        real("sd_vx_m_s", "m/s", "standard deviation of one field's vx"),
        real("sd_vy_m_s", "m/s", "standard deviation of one field's vy"),
        integer("count", "fields with a vector there"),
        integer("stagnant", "1 in the stagnation zone"),
        integer("mirrored", "1 where the other half was measured and this is its reflection"),
    ),
)
FLOW_TOPOLOGY = Product(
    file="flow_topology.parquet",
    title="Topology of the wake near the ground",
    row="a ground case of [piv]",
    version=2,
    columns=(
        text("case", "name of the case in [piv]"),
        real("z_hat", "1", "rotor plane to boundary over rotor radius"),
        real(
            "tilt_rad", "rad", "positive where the vehicle's +x side is farther from the boundary"
        ),
        integer("vortices_ccw", "standing vortices that turn counter-clockwise"),
        integer("vortices_cw", "standing vortices that turn clockwise"),
        real("stagnation_area_hat2", "1", "area of the stagnation zone over rotor radius squared"),
        real("stagnation_height_hat", "1", "height of the stagnation zone over rotor radius"),
        text("jets", "one jet or two, and the side to which the wake leans; empty if mirrored"),
    ),
)
FLOW = Product(
    file="flow.json",
    title="What was read and averaged of each velocity field",
    row="case",
    version=2,
)
FLOW_PRODUCTS = (DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW_TOPOLOGY, FLOW)


def inputs(root: Path, campaign: Campaign) -> Inputs:
    """Velocity grids, those of a case under one name: they may be hundreds."""
    from nearlift.readers.files import source_of
    from nearlift.readers.piv import files_of

    listed = {}
    for case in campaign.piv.case if campaign.piv is not None else ():
        files = [source_of(root, path) for path in files_of(root, case)]
        listed[f"[piv] {case.name} ({len(files)} files)"] = files
    return listed


def run(job: Job) -> Outcome:
    """Average every case, cut its wake, compare with the control, find the wake's topology.

    Raises
    ------
    ManifestError
        There is no [piv].
    InputRefused
        The files of a case cannot be read, or hold what cannot be.
    """
    from nearlift.flow.wakes import wakes
    from nearlift.readers.piv import Stream, files_of

    def fields(case: PivCase) -> Stream:
        assert job.campaign.piv is not None
        files = files_of(job.root, case)
        return Stream(root=job.root, piv=job.campaign.piv, case=case, files=files)

    flow_results = wakes(job.campaign, fields, job.say)
    job.write(DOWNWASH, DOWNWASH.columns_of(flow_results.downwash))
    job.write(DOWNWASH_PROFILE, tables.stacked(DOWNWASH_PROFILE, flow_results.profiles))
    job.write(FLOW_FIELDS, tables.stacked(FLOW_FIELDS, flow_results.fields))
    job.write(FLOW_TOPOLOGY, FLOW_TOPOLOGY.columns_of(flow_results.topology))
    job.write(FLOW, {"schema": FLOW.schema, **flow_results.facts})
    return Outcome(notes=tuple(flow_results.notes))


STAGE = Stage(
    name="flow",
    run=run,
    summary="average velocity fields (PIV) into downwash",
    help="Only where the manifest has [piv].",
    writes=FLOW_PRODUCTS,
    sections=("name", "vehicle", "rig", "piv"),
    inputs=inputs,
    where="piv",
)
