"""Every symbol, once: its name in code and files, how it is set, its unit, its meaning, and the
paper's symbol.

Columns of products, axis labels and documentation read this table. Names carry the unit (`z_m`,
`lift_N`); a hat means scaled by rotor radius; `u_` in front of a name is one standard uncertainty
of it.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from nearlift.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Symbol:
    """One quantity.

    Attributes
    ----------
    name : str
        As columns and keywords spell it.
    latex : str
        As figures and pages set it, without dollars.
    unit : str
        SI, ``"1"`` if dimensionless, empty for what is no number.
    meaning : str
        One phrase, with sign and datum where they matter.
    paper_symbol : str
        The symbol of Carter, Bouchard and Quinn 2021 in LaTeX; empty where the paper has none.
    """

    name: str
    latex: str
    unit: str
    meaning: str
    paper_symbol: str = ""


#: What was measured beside lift and is carried along: averaged and drawn, while no model is fitted
#: to it; and, of each, its standard uncertainty.
CARRIED = {
    "roll_moment_Nm": "u_roll_moment_Nm",
    "pitch_moment_Nm": "u_pitch_moment_Nm",
    "wall_force_N": "u_wall_force_N",
}

#: A letter with an index in a text, as ``K_b``.
INDEXED = re.compile(r"\b([A-Za-z])_([a-z]+)\b")
#: What the loop says of a campaign, in words; empty where it has not run.
VERDICTS = {
    "not_diagnosed": "not diagnosed",
    "adequate": "adequate",
    "effect": "effect identified",
    "unexplained": "unexplained structure",
}

#: What effects call the covariate along which they vary, in the schedule's words.
SCHEDULE_WORDS = {
    "z_hat": "distance",
    "supply_V": "supply",
    "temperature_K": "temperature",
    "tilt_rad": "tilt",
    "speed_hat": "rpm",
    "start_s": "start",
    "since_start_s": "start",
    "elapsed_hat": "start",
    "inverted": "orientation",
    "turn_rad": "turn",
    "other_propeller": "propeller",
    "fountain_side": "fountain",
}


def _s(name: str, latex: str, unit: str, meaning: str, paper_symbol: str = "") -> Symbol:
    return Symbol(name=name, latex=latex, unit=unit, meaning=meaning, paper_symbol=paper_symbol)


SYMBOLS: tuple[Symbol, ...] = (
    # distance and geometry
    _s("z_m", "z", "m", "rotor plane to ground or ceiling; nearest blade tip to sidewall", "z"),
    _s(
        "z_hat",
        r"\hat{z}",
        "1",
        "distance to the boundary over rotor radius (sidewall: from the nearest blade tip);"
        " infinite in free air",
        r"\hat{z}",
    ),
    _s("rotor_radius_m", "r", "m", "rotor radius", "r"),
    _s(
        "spacing_hat",
        r"\hat{d}",
        "1",
        "distance of adjacent rotor axes over rotor radius (the paper calls 90 mm so, which is the"
        " diagonal)",
        r"\hat{\ell}",
    ),
    _s("diagonal_hat", r"\hat{b}", "1", "distance of opposite rotor axes over rotor radius"),
    _s("gap_hat", r"\hat{g}", "1", "distance from ground to ceiling over rotor radius"),
    _s(
        "edge_hat",
        r"\hat{e}",
        "1",
        "distance of the ground's straight edge, along x, from the middle of the rotors over rotor"
        " radius; negative where that is beyond it",
    ),
    _s(
        "layout_hat",
        r"(\hat{x}, \hat{y})_i",
        "1",
        "rotor axes in the rotor plane over rotor radius, a row per rotor",
    ),
    _s(
        "tilt_rad",
        r"\theta",
        "rad",
        "tilt between rotor plane and boundary",
        r"\theta_\mathrm{tilt}",
    ),
    _s("turn_rad", r"\psi", "rad", "angle of the vehicle about its thrust, on the load cell"),
    # force
    _s("lift_N", "L", "N", "mean lift of the whole vehicle, tare removed", "L"),
    _s(
        "lift_inf_N",
        r"L_\infty",
        "N",
        "lift at the same throttle far from every boundary",
        r"L_\infty",
    ),
    _s("ratio", r"L / L_\infty", "1", "lift near a boundary over lift far from it", r"L/L_\infty"),
    _s(
        "delta_L",
        r"\Delta L",
        "1",
        "(L - L_inf) / L_inf; for tables and figures, never fitted",
        r"\Delta L",
    ),
    _s("sd_N", r"s_L", "N", "standard deviation of the samples of one record"),
    _s("drift_N_s", r"\dot{L}", "N/s", "slope of force within a record"),
    _s(
        "n",
        "n",
        "1",
        "number of samples averaged; in a lift model, its exponent (1 the paper's convention, 2/3"
        " constant power)",
    ),
    _s("n_eff", r"n_\mathrm{eff}", "1", "effectively independent samples among those averaged"),
    _s("n_trials", r"n_\mathrm{trials}", "1", "trials averaged in a cell"),
    # coefficients of the models
    _s("K_b", "K_b", "1", "strength of the fountain beneath the body; positive gains lift", "K_b"),
    _s(
        "inverse_K_b",
        "1/K_b",
        "1",
        "strength of the fountain where K_b is in the denominator, as the paper prints it",
        "1/K_b",
    ),
    _s("k", "k", "1", "strength of a rotor's image in the ground over the theory's"),
    _s(
        "alpha", r"\alpha", "1", "strength of the ceiling's effect on the inflow; theory 1/8", "1/8"
    ),
    _s("kappa", r"\kappa", "1", "share of an image that the ceiling of a corridor gives"),
    _s("gamma", r"\gamma", "1", "power far away over power near the ceiling, at the same thrust"),
    _s(
        "a",
        "a",
        "1",
        "amplitude of an empirical form: gain near ground or ceiling, loss near a sidewall",
    ),
    _s("b", "b", "1", "decay of an exponential gain per rotor radius"),
    _s("p", "p", "1", "power with which an effect falls off with distance"),
    _s("c", "c", "1", "strength of the empirical ceiling form, 1 / K_1"),
    _s(
        "e",
        "e",
        "1",
        "shift of the pole of the empirical ceiling form behind the ceiling, in rotor radii",
    ),
    _s("lambda_", r"\lambda", "1", "gap over which a sidewall's loss falls to 1/e, in rotor radii"),
    # what a trial is, and its covariates
    _s("trial", r"\mathrm{trial}", "", "identifier of a trial, as in the schedule"),
    _s("boundary", r"\mathrm{boundary}", "", "ground, ceiling, sidewall, or none (free air)"),
    _s("throttle", r"\tau", "1", "throttle as a fraction of full"),
    _s("start_s", r"t_0", "s", "start of the trial since the first one"),
    _s("session", r"\mathrm{session}", "", "which sitting the trial belongs to"),
    _s("visit", r"\mathrm{visit}", "", "counts the traverse's stops"),
    _s("supply_V", "U", "V", "supply voltage under load"),
    _s("current_A", "I", "A", "supply current"),
    _s("speed_Hz", "f", "Hz", "rotor frequency, revolutions per second", "f"),
    _s("power_W", "P", "W", "electrical power"),
    _s("roll_moment_Nm", "M_x", "N m", "moment about the axis from tail to nose"),
    _s("pitch_moment_Nm", "M_y", "N m", "moment about the axis from side to side"),
    _s("wall_force_N", "F_w", "N", "force along the normal of a wall, away from it positive"),
    _s("temperature_K", "T", "K", "air temperature"),
    _s("pressure_Pa", "p_a", "Pa", "air pressure"),
    _s("humidity", r"\varphi", "1", "relative humidity as a fraction"),
    _s("air_density_kg_m3", r"\rho", "kg/m^3", "density of air", r"\rho"),
    _s(
        "approach",
        r"\mathrm{approach}",
        "1",
        "+1 when the last move was away from the boundary, -1 towards it",
    ),
    _s("orientation", r"\mathrm{orientation}", "", "upright or inverted"),
    _s("propeller", r"\mathrm{propeller}", "", "name of the propellers that the trial ran with"),
    _s(
        "fountain_side",
        r"\sigma",
        "1",
        "+1 and -1 in the fountain's two states, as seen; 0 in neither",
    ),
    _s("tare_after_N", r"F_0'", "N", "tare after the trial"),
    _s("quality", r"\mathrm{quality}", "", "quality codes; empty is good"),
    _s("source", r"\mathrm{source}", "", "file of a record, relative to the campaign's folder"),
    _s(
        "samples",
        r"N_\mathrm{read}",
        "1",
        "samples in a record as read, tare and settling included",
    ),
    _s(
        "completeness",
        r"\mathrm{completeness}",
        "",
        "complete, truncated, malformed, pending or missing",
    ),
    _s("fault", r"\mathrm{fault}", "", "what is wrong with a malformed record"),
    # the vehicle and its simulation
    _s("mass_kg", "m", "kg", "mass of the vehicle", "m"),
    _s("gravity_m_s2", "g", "m/s^2", "acceleration of free fall", "g"),
    _s("C_L", "C_L", "1", "rotor lift coefficient, L / (4 rho f^2 r^4) with f in Hz", "C_L"),
    _s("C_P", "C_P", "1", "rotor power coefficient, P / (rho f^3 r^5)", "C_P"),
    _s("inertia_kg_m2", "J_x", "kg m^2", "rolling moment of inertia", "I"),
    _s("target_z_hat", r"\hat{z}_0", "1", "target height over rotor radius", r"\hat{z}_0"),
    _s("disturbance_N", "L'", "N", "simulated vertical disturbance", "L'"),
    _s(
        "crash_rate", r"p_\mathrm{crash}", "1", "share of simulated flights that touch the boundary"
    ),
    _s(
        "relative_energy",
        r"(L/L_\infty)^{-3/2}",
        "1",
        "power to hover near the boundary over power far from it, as the paper takes it",
        r"(L/L_\infty)^{-3/2}",
    ),
    _s(
        "alpha_group",
        r"\alpha",
        "1",
        "proportional gain without unit, k_P sqrt(4 C_L rho r^6 / (m g))",
        r"\alpha",
    ),
    _s(
        "beta_group",
        r"\beta",
        "1",
        "derivative gain without unit, k_D sqrt(4 C_L rho r^5 / m)",
        r"\beta",
    ),
    _s(
        "gamma_group",
        r"\gamma",
        "1",
        "integral gain without unit, k_I sqrt(4 C_L rho r^7 / (m g^2))",
        r"\gamma",
    ),
    _s(
        "noise_group",
        r"\sigma_{L'} / m g",
        "1",
        "standard deviation of the disturbance over weight",
        r"L'/mg",
    ),
    _s("downwash", r"v / v_\infty", "1", "induced velocity over its value far from the boundary"),
    _s("speed_m_s", r"\lvert \mathbf{u} \rvert", "m/s", "in-plane flow speed", r"\mathbf{u}"),
)


_BY_NAME = {s.name: s for s in SYMBOLS}
#: Greek letters of coefficients, in LaTeX and plain text.
GREEK = {r"\alpha": "α", r"\gamma": "γ", r"\lambda": "λ"}


def latex(name: str) -> str:
    """LaTeX of a name, without dollars; a name without a symbol is unchanged."""
    return _BY_NAME[name].latex if name in _BY_NAME else name


def letter(coefficient: str) -> str:
    """A coefficient's name in plain text, as captions have it: Greek where it is Greek."""
    text = latex(coefficient)
    for spelled, greek in GREEK.items():
        text = text.replace(spelled, greek)
    if "\\" in text:
        text = coefficient
    head = text.partition("_")[0]
    return text if len(head) == 1 or "/" in head else text.replace("_", " ").strip()


def noun(coefficient: str) -> str:
    """Its letter within a sentence, where a bare a would be read as an article."""
    said = letter(coefficient)
    return f"coefficient {said}" if said.isascii() and len(said) == 1 else said


def mathematics(coefficient: str) -> str:
    """A coefficient's name between dollars, as LaTeX, Markdown and figures set it; one without a
    letter in words.
    """
    if coefficient in _BY_NAME:
        return f"${latex(coefficient)}$"
    head, _, index = letter(coefficient).partition("_")
    return (f"${head}_{{{index}}}$" if index else f"${head}$") if len(head) == 1 else head


def symbol(name: str) -> Symbol:
    """The symbol of that name; a name beginning with `u_` is one standard uncertainty of the rest.

    Raises
    ------
    UsageError
        There is none; the nearest names are proposed.
    """
    if name in _BY_NAME:
        return _BY_NAME[name]
    if name.startswith("u_") and name[2:] in _BY_NAME:
        of = _BY_NAME[name[2:]]
        return Symbol(
            name=name,
            latex=f"u({of.latex})",
            unit=of.unit,
            meaning=f"standard uncertainty of {of.name}: {of.meaning}",
        )
    near = difflib.get_close_matches(name, _BY_NAME, n=3)
    raise UsageError(
        "symbol",
        f"there is no symbol {name!r}",
        f"did you mean {' or '.join(near)}?" if near else "`nearlift describe` lists them",
    )


def label(name: str, unit: str | None = None) -> str:
    r"""Axis label such as ``$z$ (m)`` or ``$\hat{z}$``; `unit` replaces the SI unit where a figure
    draws another, such as ``"%"``.
    """
    known = symbol(name)
    shown = known.unit if unit is None else unit
    return f"${known.latex}$" if shown in ("", "1") else f"${known.latex}$ ({shown})"
