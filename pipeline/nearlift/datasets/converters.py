"""Published files as campaigns of means.

Each data set gives the table of its schedule, and the facts that fill in the template of its
manifest, ``<converter>.toml``.

A converter takes the paths of the files by name, and the name of the data set.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from nearlift.errors import InputRefused

Files = Mapping[str, Path]
Converted = tuple[pd.DataFrame, dict[str, object]]
#: Below this throttle the Pitt-RAS stand reads little more than its own friction.
MIN_THROTTLE = 0.15
#: Pulse widths of zero and full throttle of the older Pitt-RAS sweeps, us.
ZERO_US, FULL_US = 1000.0, 2100.0
#: Full pulse width of a Crazyflie, and rows of the shortest dwell that is a trial.
FULL_PWM, MIN_DWELL_ROWS = 65535, 90
#: SHA-256 of the numbers of Garofano-Soldado et al. as `garofano_soldado_table` writes them.
GAROFANO_SOLDADO_SHA256 = "73877bf965146079ee3b7990bd62a96ae6dcfe45038ee6afe61a227a211a9802"


def pitt_ras(files: Files, name: str) -> Converted:
    """Pitt-RAS 2017: sweeps of 50 throttles, a file each, a session each.

    The name of a file holds the start of its sweep.
    """
    stamps = [re.search(r"_(\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d\.\d+)", file) for file in files]
    if not all(stamps):
        raise InputRefused(
            ", ".join(files),
            "a name does not hold the start of its sweep",
            "thrust_data_YYYY-MM-DD_HH-MM-SS.ssssss.csv",
        )
    texts = [stamp[1] for stamp in stamps if stamp]
    starts = pd.Series(pd.to_datetime(texts, format="%Y-%m-%d_%H-%M-%S.%f"), index=[*files])
    seconds = (starts - starts.min()).dt.total_seconds().sort_values()
    sweeps = []
    for session, (file, start) in enumerate(seconds.items(), 1):
        sweep = _read(files[str(file)], ["throttle", "lift", "supply", "distance"], header=None)
        trial = [f"r{session:02d}-{step:02d}" for step in sweep.index]
        sweeps.append(sweep.assign(trial=trial, session=session, start=f"{start:.6f}"))
    table = pd.concat(sweeps).assign(boundary="ground")
    table["supply"] = table["supply"].round(2)
    return table[table["throttle"] > MIN_THROTTLE], {}


def pitt_ras_older(files: Files, name: str) -> Converted:
    """Pitt-RAS 2017: six older sweeps, typed into the script that fitted them, or a transcript of
    them as CSV. Sweeps that the authors commented out are left out.
    """
    (path,) = files.values()
    columns = ["session", "lift", "pulse_us", "supply", "distance"]
    if path.suffix == ".csv":
        transcribed = ["sweep", "force_raw", "throttle_us", "vbat_V", "dist_to_ground_m"]
        table = _read(path, transcribed, header=0).set_axis(columns, axis=1)
    else:
        sweeps = re.split(r"(?m)^\s*np\.array\(\(", path.read_text(encoding="utf-8"))[1:]
        row = re.compile(r"(?m)^\s*\(\s*([\d.]+)\s*,\s*([\d.]+)\s*,\s*([\d.]+)\s*,\s*([\d.]+)\s*\)")
        rows = [
            (k, *numbers) for k, sweep in enumerate(sweeps, 1) for numbers in row.findall(sweep)
        ]
        if not rows:
            raise InputRefused(str(path), "has no sweeps np.array((...))", "it is another file")
        table = pd.DataFrame(rows, columns=columns).astype(float)
    table["session"] = table["session"].astype(int)
    table["trial"] = [f"s{k}-{i:02d}" for i, k in enumerate(table["session"])]
    table["throttle"] = (table.pop("pulse_us") - ZERO_US) / (FULL_US - ZERO_US)
    return table[(table["throttle"] > MIN_THROTTLE) & (table["lift"] > 0)], {}


def jirs(files: Files, name: str) -> Converted:
    """J Intell Robot Syst 110.3 (2024): means at five distances by four pulse widths.

    The name of the data set ends with its table, such as ``ceiling-12-inch``.
    """
    (path,) = files.values()
    wanted = re.search(r"(ground|ceiling)-(\d+)-inch$", name)
    if wanted is None:
        raise InputRefused(name, "names no table", "end it with ground-10-inch, for example")
    boundary, inches = wanted[1], int(wanted[2])
    # the second rotor's speed is blank nearest the ceiling
    speed = "rpm_1" if (boundary, inches) == ("ceiling", 10) else "rpm_mean"
    # as text, so that speeds keep their digits
    every = pd.read_csv(path, dtype=str)
    rows = every[
        every["row_type"].str.contains("measurement")
        & (every["effect"] == boundary)
        & (every["prop_diameter_in"] == wanted[2])
    ]
    if rows.empty:
        raise InputRefused(str(path), f"has no rows of {boundary}, {inches} inches", "see its list")
    table = pd.DataFrame(
        {
            "trial": [f"t{i:02d}" for i in range(len(rows))],
            "distance": rows["distance_cm"],
            "throttle": (rows["pwm"].astype(float) - 1000) / 10,
            "rpm": rows[speed],
            "lift": rows["fz_n"],
        }
    )
    return table, {"boundary": boundary, "inches": inches, "radius": 12.7 * inches}


def crazyflie_stand(files: Files, name: str) -> Converted:
    """A Crazyflie 2.1 on a thrust stand: dwells of constant pulse width as trials in free air, and
    the throttle map that they give. A file is a session.

    The first half of a dwell is left for rotors and cell to settle. Weights are tared by the rows
    before the rotors turn. The cell is read more rarely than rows are written.
    """
    trials = []
    for session, path in enumerate(files.values(), 1):
        speeds = [f"rpm{i}" for i in range(1, 5)]
        rows = _read(path, ["weight[g]", "pwm", "vbat[V]", *speeds], header=0)
        rows["rpm"] = rows[speeds].where(rows[speeds] > 0).mean(axis=1)
        dwells = [dwell for _, dwell in rows.groupby((rows["pwm"].diff() != 0).cumsum())]
        if not dwells or dwells[0]["pwm"].iloc[0] != 0:
            raise InputRefused(
                str(path), "does not begin with rotors at rest", "its weights cannot be tared"
            )
        for place, dwell in enumerate(dwells):
            if dwell["pwm"].iloc[0] == 0 or len(dwell) < MIN_DWELL_ROWS:
                continue
            settled = dwell.iloc[len(dwell) // 2 :]
            weight = settled["weight[g]"]
            readings = weight[weight.diff() != 0]
            trials.append(
                {
                    "trial": f"s{session}-{place:03d}",
                    "boundary": "none",
                    "distance": None,
                    "throttle": round(settled["pwm"].iloc[0] / FULL_PWM, 6),
                    "lift": readings.mean() - dwells[0]["weight[g]"].mean(),
                    "lift_sd": readings.std() if len(readings) > 1 else 0.0,
                    "n": len(readings),
                    "supply": settled["vbat[V]"].mean(),
                    "rpm": settled["rpm"].mean(),
                    "session": session,
                }
            )
    table = pd.DataFrame(trials)
    points = table.groupby("throttle")["rpm"].mean().items()
    listed = ", ".join(
        f'["{100 * float(str(t)):.4g} percent", "{rpm:.0f} rpm"]' for t, rpm in points
    )
    return table, {"points": listed}


def garofano_soldado(files: Files, name: str) -> Converted:
    """Garofano-Soldado et al.: 15 configurations of tilt at ten heights, from the MATLAB script of
    their figures or from its table as CSV.

    A name that ends with ``-axes`` asks for the force along the rotors' axes. Neither the order of
    the runs, the number of samples, nor the spacing of the rotors is published. The standard
    deviation is taken as that of the mean, which is cautious.
    """
    (path,) = files.values()
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix != ".csv":
        text = garofano_soldado_table(text, str(path))
    if hashlib.sha256(text.encode()).hexdigest() != GAROFANO_SOLDADO_SHA256:
        raise InputRefused(
            str(path),
            "holds other numbers than those that are known here",
            "compare it with the paper; delete it to fetch it again",
        )
    return tilted_pairs(pd.read_csv(io.StringIO(text)), along_axes=name.endswith("-axes"))


def garofano_soldado_table(script: str, where: str) -> str:
    """CSV of the script's rows: case, configuration, tilts in degrees, height over R and in m, force
    and its standard deviation in N.
    """
    assigned = dict(re.findall(r"(?m)^(\w+)\s*=\s*\[([^\[\]]*)\]", script))
    radius = re.search(r"(?m)^R\s*=\s*([\d.]+)", script)
    heights = {
        len(z): z
        for cells in (assigned[n].split(",") for n in reversed(assigned) if n.startswith("z"))
        for z in [[float(cell.split("*")[0]) for cell in cells]]
    }
    lines = ["case,config,alpha_deg,beta_deg,z_over_R,z_m,Fz_N,Fz_std_N"]
    # the sign of beta is in the name of the case
    facing = {"": "coplanar", "_beta": "back_to_back", "_minbeta": "face_to_face"}
    for case, values in assigned.items():
        tilts = re.fullmatch(r"Fz(\d+)(_minbeta|_beta|)(\d*)", case)
        if tilts is None:
            continue
        forces, spreads = (map(float, v.split()) for v in (values, assigned.get(f"std_{case}", "")))
        try:
            rows = [*zip(heights.get(len(values.split()), []), forces, spreads, strict=True)]
        except ValueError:
            rows = []
        if radius is None or not rows:
            raise InputRefused(where, f"lacks R, heights or deviations of {case}", "it is cut")
        lines += [
            f"{case},{facing[tilts[2]]},{tilts[1]},{tilts[3] or 0}"
            f",{z!r},{z * float(radius[1])!r},{force!r},{spread!r}"
            for z, force, spread in rows
        ]
    return "\n".join(lines) + "\n"


def tilted_pairs(published: pd.DataFrame, *, along_axes: bool) -> Converted:
    """Schedule of the published table; forces over cos(alpha) cos(beta) with `along_axes`."""
    cosines = np.cos(np.radians(published["alpha_deg"])) * np.cos(np.radians(published["beta_deg"]))
    share = cosines if along_axes else 1.0
    # tilted towards each other counts positive
    sign = published["config"].map({"face_to_face": 1, "coplanar": 0, "back_to_back": -1})
    table = pd.DataFrame(
        {
            "trial": published["case"] + published["z_over_R"].map("-{:g}".format),
            "distance": published["z_m"],
            "session": published["case"],
            "tilt": sign * published["alpha_deg"],
            "beta": published["beta_deg"],
            "lift": published["Fz_N"] / share,
            "lift_sd": published["Fz_std_N"] / share,
        }
    )
    note = (
        "vertical force over cos(alpha) cos(beta): thrust along the rotors' axes if it does not"
        " care about tilt"
        if along_axes
        else "vertical force as measured"
    )
    return table, {"note": note}


def _read(path: Path, columns: Sequence[str], header: int | None) -> pd.DataFrame:
    """Columns of a CSV table, all numbers; without a `header` they are all that there are."""
    try:
        table = pd.read_csv(path, header=header, names=None if header == 0 else [*columns])
        numbers = table[[*columns]].astype(float)
    except (KeyError, ValueError):
        numbers = pd.DataFrame([float("nan")])
    if numbers.isna().any(axis=None):
        what = f"is not the published table of {len(columns)} columns of numbers"
        raise InputRefused(str(path), what, f"its columns: {', '.join(columns)}")
    return numbers


CONVERTERS: dict[str, Callable[[Files, str], Converted]] = {
    made.__name__: made
    for made in (crazyflie_stand, garofano_soldado, jirs, pitt_ras, pitt_ras_older)
}


def write_campaign(folder: Path, converter: str, files: Files, name: str) -> None:
    """Write ``campaign.toml`` and ``trials.csv`` of a data set into a folder that is made.

    Raises
    ------
    InputRefused
        A file does not hold what it should; nothing is written.
    """
    table, facts = CONVERTERS[converter](files, name)
    template = Path(__file__).with_name(f"{converter}.toml").read_text(encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "trials.csv", index=False, float_format="%.6g")
    (folder / "campaign.toml").write_text(template.format(name=name, **facts), encoding="utf-8")
