"""Make the figures of docs/garofano-soldado.md: ``python docs/worked/garofano_soldado.py SCRIPT``.

SCRIPT is the published data_nonplanar_rotors.m. Numbers go to docs/worked/garofano_soldado.json; the
data stay where they are.
"""

import csv
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from nearlift.datasets.converters import garofano_soldado_table
from nearlift.report.figures.style import DOUBLE_IN, REFERENCES, SERIES, context

HERE = Path(__file__).resolve().parent
FIGURES = HERE.parent / "figures"
Curve = Callable[..., Any]
#: Ratio far from the ground 1; each with its number of free coefficients and where a fit starts.
MODELS: dict[str, tuple[Curve, tuple[float, ...]]] = {
    "Cheeseman-Bennett": (lambda z: 1 / (1 - 1 / (16 * z**2)), ()),
    "Cheeseman-Bennett, free k": (lambda z, k: 1 / (1 - k / (16 * z**2)), (1.0,)),
    "power law": (lambda z, a, p: 1 + a * z**-p, (0.1, 1.5)),
    "exponential": (lambda z, a, b: 1 + a * np.exp(-b * z), (0.4, 1.5)),
}
FACING = {
    "coplanar": "coplanar",
    "face_to_face": "towards each other",
    "back_to_back": "away from each other",
}
#: Heights over radius from which the ground is taken to be far; C-B has 0.7 % at 3.
FAR = 3.0


def configurations(script: Path) -> list[dict[str, Any]]:
    """The numbers by configuration, forces also along the rotors' axes."""
    text = garofano_soldado_table(script.read_text(encoding="utf-8", errors="replace"), str(script))
    found: dict[str, dict[str, Any]] = {}
    for row in csv.DictReader(io.StringIO(text)):
        alpha, beta = float(row["alpha_deg"]), float(row["beta_deg"])
        at = found.setdefault(
            row["case"],
            {
                "case": row["case"],
                "facing": row["config"],
                "alpha": alpha,
                "beta": beta,
                "z": [],
                "force": [],
                "sd": [],
            },
        )
        for key, column in (("z", "z_over_R"), ("force", "Fz_N"), ("sd", "Fz_std_N")):
            at[key].append(float(row[column]))
    for at in found.values():
        at |= {k: np.array(at[k]) for k in ("z", "force", "sd")}
        at["share"] = np.cos(np.radians(at["alpha"])) * np.cos(np.radians(at["beta"]))
        far = at["z"] >= FAR
        at["far"], at["far_scatter"] = at["force"][far].mean(), at["force"][far].std(ddof=1)
    return list(found.values())


def fit(at: dict[str, Any], model: str) -> tuple[float, int, np.ndarray]:
    """Chi-square at the published standard deviations, degrees of freedom, and the fitted numbers,
    L_inf first.
    """
    curve, start = MODELS[model]
    found = least_squares(
        lambda t: (t[0] * curve(at["z"], *t[1:]) - at["force"]) / at["sd"], [at["far"], *start]
    )
    return 2 * found.cost, len(at["z"]) - 1 - len(start), found.x


def draw_models(found: list[dict[str, Any]]) -> Figure:
    """The coplanar pair beside its fits; chi-square over its degrees of freedom for all
    configurations.
    """
    figure = Figure(figsize=(DOUBLE_IN, 2.7), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    at = found[0]
    looks = [
        (REFERENCES[0][0], REFERENCES[0][1]),
        (SERIES[1][0], "-"),
        (SERIES[0][0], "--"),
        (SERIES[2][0], ":"),
    ]
    for (name, (curve, _)), (colour, dash) in zip(MODELS.items(), looks, strict=True):
        _, _, x = fit(at, name)
        expected = x[0] * curve(at["z"], *x[1:])
        left.plot(
            at["z"],
            100 * (at["force"] / expected - 1),
            color=colour,
            linestyle=dash,
            label=name,
            marker="o",
            markersize=2.5,
        )
    left.fill_between(
        at["z"],
        -100 * at["sd"] / at["force"],
        100 * at["sd"] / at["force"],
        color="0.85",
        linewidth=0,
        label="published sd",
    )
    left.axhline(0, color="0.3", linewidth=0.6)
    left.set_xscale("log")
    left.set_xticks([0.6, 1, 2, 3, 5], ["0.6", "1", "2", "3", "5"])
    left.minorticks_off()
    left.set_xlabel(r"$z / R$")
    left.set_ylabel("force over fit $-$ 1 (%)")
    left.set_title("coplanar pair", loc="left")
    left.set_ylim(-6.6, 3.2)
    left.legend(loc="lower right")
    place = np.arange(len(found))
    for i, ((name, _), (colour, _)) in enumerate(zip(MODELS.items(), looks, strict=True)):
        values = [fit(c, name)[0] / fit(c, name)[1] for c in found]
        right.plot(
            values,
            place + 0.18 * (1.5 - i),
            linestyle="none",
            marker=SERIES[i][1],
            markersize=3.5,
            color=colour,
            label=name,
        )
    right.axvline(1, color="0.3", linewidth=0.6)
    right.set_xscale("log")
    right.set_yticks(place, [label(c) for c in found])
    right.tick_params(axis="y", length=0)
    right.invert_yaxis()
    right.set_xlabel(r"$\chi^2$ over degrees of freedom, at the published sd")
    right.set_title("every configuration, each with its own $L_\\infty$", loc="left")
    right.grid(axis="y", color="0.92", linewidth=0.5)
    right.set_axisbelow(True)
    return figure


def label(at: dict[str, Any]) -> str:
    """A configuration in short: its tilts, and which way alpha leans."""
    way = {"coplanar": "", "face_to_face": " in", "back_to_back": " out"}[at["facing"]]
    return rf"$\alpha$ {at['alpha']:.0f}°{way if at['alpha'] else ''}, $\beta$ {at['beta']:.0f}°"


def draw_tilt(found: list[dict[str, Any]]) -> Figure:
    """Thrust along the axes far away, and the gain closest to the ground, against tilt."""
    figure = Figure(figsize=(DOUBLE_IN, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    flat = found[0]
    groups = (
        ("face_to_face", 0, SERIES[1]),
        ("back_to_back", 0, SERIES[0]),
        ("back_to_back", 10, SERIES[2]),
        ("back_to_back", 20, SERIES[3]),
    )
    for facing, beta, (colour, marker) in groups:
        mine = [
            c
            for c in found
            if (c["facing"] in (facing, *(("coplanar",) if beta == 0 else ())))
            and c["beta"] == beta
        ]
        alpha = np.array([c["alpha"] for c in mine])
        shown = rf"$\alpha$ {'in' if facing == 'face_to_face' else 'out'}, $\beta$ = {beta}°"
        thrust = np.array([c["far"] / c["share"] for c in mine]) / flat["far"]
        spread = np.array([c["far_scatter"] / c["share"] for c in mine]) / flat["far"]
        left.errorbar(
            alpha,
            100 * (thrust - 1),
            100 * spread,
            color=colour,
            marker=marker,
            label=shown,
            capsize=2,
            elinewidth=0.7,
        )
        near = np.array([c["force"][0] / c["far"] - 1 for c in mine])
        u = np.array([np.hypot(c["sd"][0], c["far_scatter"]) / c["far"] for c in mine])
        right.errorbar(
            alpha, 100 * near, 100 * u, color=colour, marker=marker, capsize=2, elinewidth=0.7
        )
    left.axhline(0, color="0.3", linewidth=0.6)
    left.set_ylabel("thrust along the axes,\nover the coplanar pair's $-$ 1 (%)")
    left.set_title(f"far from the ground, $z / R \\geq {FAR:g}$", loc="left")
    left.legend(loc="upper left")
    right.set_ylabel("gain of vertical force (%)")
    right.set_title("closest to the ground, $z / R = 0.6$", loc="left")
    for ax in (left, right):
        ax.set_xticks([0, 10, 20, 30])
        ax.set_xlabel(r"tilt $\alpha$ (deg)")
    return figure


def save(figure: Figure, name: str) -> None:
    """A PNG for the page, without dates."""
    figure.savefig(FIGURES / f"{name}.png", dpi=200, metadata={"Software": None})


if __name__ == "__main__":
    found = configurations(Path(sys.argv[1]))
    with context():
        save(draw_models(found), "garofano-models")
        save(draw_tilt(found), "garofano-tilt")
    rows = [
        {
            "case": c["case"],
            "facing": FACING[c["facing"]],
            "alpha_deg": c["alpha"],
            "beta_deg": c["beta"],
            "chi2_over_dof": {n: round(fit(c, n)[0] / fit(c, n)[1], 1) for n in MODELS},
            "k": round(float(fit(c, "Cheeseman-Bennett, free k")[2][1]), 3),
            "axis_thrust_far": round(float(c["far"] / c["share"] / (found[0]["far"])), 4),
            "gain_at_0.6": round(float(c["force"][0] / c["far"] - 1), 4),
        }
        for c in found
    ]
    (HERE / "garofano_soldado.json").write_text(json.dumps(rows, indent=1) + "\n")
