"""A table of means or of trials is seen by its shape, and several tables are named."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run, written
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.shown import block, notes
from nearlift.schedule import read_schedule


def table(distance: str, throttle: str, lift: str, more: str = "") -> bytes:
    """A table of means under such headings: four distances at three throttles."""
    rows = [f"{distance},{throttle},{lift}{',' + more if more else ''}"]
    for h in (20, 35, 60, 200):
        for t in (40, 55, 70):
            rows.append(f"{h},{t},{t * t / 10 + 400 / h:.2f}{',1.5' if more else ''}")
    return ("\n".join(rows) + "\n").encode()


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("Thrust mean (g)", "gf"),
        ("thrust_mean_g", "gf"),
        ("T (N)", "N"),
        ("Thrust (lbs)", "lbf"),
        ("Mean thrust", "FILL IN"),
        ("lift_gf", "gf"),
        ("Schub [mN]", "mN"),
        ("measured by cell (kg)", "kgf"),
        ("Thrust (lbf) avg", "lbf"),
        ("F", "FILL IN"),
        ("portance moyenne (gf)", "gf"),
        ("T̄ [gf]", "gf"),
    ],
)
def test_a_table_of_means_is_seen_by_its_shape(tmp_path: Path, heading: str, unit: str) -> None:
    content = table("Bodenabstand (mm)", "Gas (%)", heading, "Std dev (g)")
    seen = inspect(written.put(tmp_path, "t.csv", content))
    tables = tomllib.loads(block(seen))
    assert tables["records"] == {"reader": "means"}
    assert tables["trials"]["units"]["lift"] == unit
    assert tables["trials"]["units"]["lift_sd"] == "gf"
    assert seen.table is not None
    columns = seen.table.schedule().trials.columns.to_list()
    assert columns == ["trial", "distance", "throttle", "lift", "lift_sd"]


def proposed(path: Path) -> tuple[list[str], dict[str, str]]:
    """Lines of the schedule that `new` makes of a table, and its columns' units."""
    answer = nearlift("new", path.parent / "c", "--from", path)
    assert answer.exit_code == 0, answer.output
    manifest = tomllib.loads((path.parent / "c" / "campaign.toml").read_text())
    assert manifest["records"] == {"reader": "means"}
    return (path.parent / "c" / "trials.csv").read_text().splitlines(), manifest["trials"]["units"]


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("height,throttle,lift", "{h} mm,40 %,{a} N\n{h} mm,60 %,{b} N"),
        ("h_mm,throttle,Lift [N]", "{h},40%,{a} N\n{h},60%,{b} N"),
        ("height (mm),Lift (N),\n,40 %,60 %", "{h},{a},{b}"),
        ("height (mm),Lift (N) at throttle,\n,40 %,60 %", "{h},{a},{b}"),
    ],
)
def test_units_and_throttles_in_cells(tmp_path: Path, header: str, row: str) -> None:
    rows = [row.format(h=h, a=2 + 4 / h, b=4 + 8 / h) for h in (20, 40, 80, 160)]
    path = written.put(tmp_path, "t.csv", "\n".join([header, *rows, ""]).encode())
    lines, units = proposed(path)
    assert units == {"distance": "mm", "throttle": "percent", "lift": "N"}
    assert lines[0] == "trial,distance,throttle,lift"
    assert len(lines) == 9
    assert "1,20,40,2.2" in lines


@pytest.mark.parametrize(
    "cell", ["{0} ± {1}", "{0} \\pm {1}", "{0} +/- {1} N", "{0}({2})", "{0}({2}) N", "{0}({1})"]
)
@pytest.mark.parametrize("form", ["csv", "markdown", "side by side"])
def test_a_mean_with_its_deviation_in_one_cell(tmp_path: Path, cell: str, form: str) -> None:
    lifts = [
        cell.format(f"{m:.3f}", f"0.01{k}", f"1{k}") for k, m in enumerate((1.5, 2.5, 3.5, 4.5))
    ]
    heading = "Thrust, mean (SD) (N)" if form == "markdown" else "Thrust (N)"
    rows = [("h (mm)", "Throttle (%)", heading)]
    rows += [(h, t, lifts.pop(0)) for h in ("20", "40") for t in ("40", "60")]
    if form == "side by side":
        rows = [
            ("h (mm)", "40 % (N)", "60 % (N)"),
            ("20", rows[1][2], rows[3][2]),
            ("40", rows[2][2], rows[4][2]),
        ]
    text = "".join(",".join(row) + "\n" for row in rows)
    if form == "markdown":
        lines = [f"| {' | '.join(row)} |\n" for row in rows]
        text = "".join([lines[0], "|---|:--:|--:|\n", *lines[1:]])
    lines, units = proposed(written.put(tmp_path, "t.md", text.encode()))
    assert units == {"distance": "mm", "throttle": "percent", "lift": "N", "lift_sd": "N"}
    assert lines[0] == "trial,distance,throttle,lift,lift_sd"
    assert [line.split(",")[-2:] for line in lines[1:]] == [
        [f"{m:.3f}", f"0.01{k}"] for k, m in enumerate((1.5, 2.5, 3.5, 4.5))
    ]


@pytest.mark.parametrize(
    ("cell", "pair"),
    [
        ("134.9e-3 ± 1.5e-3", ["134.9e-3", "1.5e-3"]),
        ("0.2 ± 1.5%", ["0.2", "0.003"]),
        ("0.2", ["0.2", ""]),
        ("", None),
    ],
)
def test_other_deviations_in_cells_and_rows_without_a_lift(
    tmp_path: Path, cell: str, pair: list[str] | None
) -> None:
    text = f"h (mm),throttle (%),lift (N)\n20,40,0.3 ± 0.1\n20,60,{cell}\n40,40,0.2 ± 0.1\n"
    lines, _ = proposed(written.put(tmp_path, "t.csv", text.encode()))
    assert lines[1] == "1,20,40,0.3,0.1"
    if pair is None:
        assert lines[2:] == ["2,40,40,0.2,0.1"]
    else:
        assert lines[2].split(",")[-2:] == pair


def test_a_blank_is_a_gap_where_a_trial_can_have_one(tmp_path: Path) -> None:
    text = (
        "boundary,h (mm),throttle (%),rpm,lift (N),remark\nnone,,40,,0.3,\nground,20,40,900,0.4,\n"
    )
    path = written.put(tmp_path, "t.csv", text.encode())
    channels = {c.name: c.values for c in inspect(path).contents.channels}
    assert np.isnan(channels["rpm"]).tolist() == [True, False]
    assert "remark" not in channels
    assert proposed(path)[0][1:] == ["1,none,,40,,0.3,", "2,ground,20,40,900,0.4,"]


@pytest.mark.parametrize(
    ("h", "lift", "said"),
    [
        ("", "0.3", "column 'h (mm)', row 2 is ''"),
        ("20", "$0.3$", "column 'lift (N)', row 1 is '$0.3$'"),
        ("20", "0.300(1.5)", "column 'lift (N)', row 1 is '0.300(1.5)'"),
        ("20", "3.00e-1(15)", "column 'lift (N)', row 1 is '3.00e-1(15)'"),
    ],
)
def test_new_refuses_cells_that_ingest_would(tmp_path: Path, h: str, lift: str, said: str) -> None:
    text = f"h (mm),throttle (%),lift (N)\n20,40,{lift}\n{h},60,{lift}\n40,40,{lift}\n"
    path = written.put(tmp_path, "t.csv", text.encode())
    answer = nearlift("new", tmp_path / "c", "--from", path)
    assert (answer.exit_code, said in answer.stderr) == (4, True), answer.stderr
    assert not (tmp_path / "c").exists()


def test_the_schedules_name_comes_first_and_a_standard_error_is_no_deviation(
    tmp_path: Path,
) -> None:
    text = "h (mm),throttle (%),thrust (N),lift (N),std error (N),reps\n" + "".join(
        f"{h},{t},{h},{h}.5,0.1,9\n" for h in (20, 40) for t in (40, 60)
    )
    path = written.put(tmp_path, "t.csv", text.encode())
    said = " ".join(notes(inspect(path)))
    assert "'thrust (N)' may be the lift, too: 'lift (N)' is taken" in said
    assert "'std error (N)' is not read: a standard error times the square root of n" in said
    lines, _ = proposed(path)
    assert lines[:2] == [
        "trial,distance,throttle,lift,n,thrust (N),std error (N)",
        "1,20,40,20.5,9,20,0.1",
    ]


def test_a_table_of_latex_is_refused(tmp_path: Path) -> None:
    text = b"\\begin{tabular}{ll}\nh (mm) & F (N) \\\\ \\hline\n20 & 3 \\\\\n40 & 2 \\\\\n\\end{tabular}\n"
    answer = nearlift("inspect", written.put(tmp_path, "t.tex", text))
    assert (answer.exit_code, "export it as CSV" in answer.stderr) == (4, True)


def test_means_with_decimal_commas(tmp_path: Path) -> None:
    rows = (
        "h;gas;Schub\n20 mm;30 %;1,20 ± 0,01 N\n20 mm;50 %;1,25 ± 0,02 N\n4,5 mm;30 %;1,1 ± 0,2 N\n"
    )
    lines, _ = proposed(written.put(tmp_path, "t.csv", rows.encode()))
    assert lines[1:] == ["1,20,30,1.20,0.01", "2,20,50,1.25,0.02", "3,4.5,30,1.1,0.2"]


def test_cells_in_several_units_are_named(tmp_path: Path) -> None:
    rows = "".join(f"{h},40 %,{2 + 1 / i} N\n" for i, h in enumerate(("8 mm", "4 cm", "9 cm"), 1))
    seen = inspect(written.put(tmp_path, "t.csv", f"height,throttle,lift\n{rows}".encode()))
    assert "column 'height', row 1 is '8 mm'" in " ".join(notes(seen))


def test_a_maximum_is_no_lift_and_two_cells_are_no_table_of_means(tmp_path: Path) -> None:
    lines = table("h_mm", "thr_pct", "Max thrust (g)", "Mean thrust (g)")
    means = inspect(written.put(tmp_path, "a.csv", lines)).table
    assert means is not None
    assert means.means
    assert means.written["lift"] == "Mean thrust (g)"
    both = table("h_mm", "thr_pct", "left (N)", "right (N)")
    two = inspect(written.put(tmp_path, "b.csv", both)).table
    assert two is None or not two.means


def test_a_record_in_steps_that_logs_its_distance_is_no_table_of_means(tmp_path: Path) -> None:
    rows = [f"{20 if i < 400 else 60},{50},{3 + (i % 7) / 10}" for i in range(800)]
    path = written.put(tmp_path, "r.csv", "\n".join(["h_mm,thr_pct,thrust_g", *rows, ""]).encode())
    assert inspect(path).table is None


@pytest.mark.parametrize(("unit", "unit_mm"), [("R", 23), ("2 R", 46)])
def test_distances_in_rotor_radii_and_diameters(tmp_path: Path, unit: str, unit_mm: float) -> None:
    root = small_run.write_means(tmp_path / "raw", 24)
    text = (root / "campaign.toml").read_text()
    before = read_schedule(manifests.load(root), root).z_hat
    header, *rows = (root / "trials.csv").read_text().splitlines()
    place = header.split(",").index("distance")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[place] = f"{float(row[place]) / unit_mm:.6f}"
    (root / "trials.csv").write_text("\n".join([header, *map(",".join, cells)]) + "\n")
    (root / "campaign.toml").write_text(text.replace('distance = "mm"', f'distance = "{unit}"'))
    assert read_schedule(manifests.load(root), root).z_hat == pytest.approx(before, rel=1e-5)


STACKED = "h_mm,T_g\n20,300\n30,280\n60,250\n\nh_mm,T_g\n20,410\n30,390\n60,350\n"
ASIDE = "h_mm,T_g,,h_mm,T_g\n20,300,,20,410\n30,280,,30,390\n60,250,,60,350\n"
DASHES = "h_mm,-,T_g,-\n20,1,300,1\n30,1,280,1\n60,1,250,1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [(STACKED, "holds 2 tables"), (ASIDE, "two tables side by side"), (DASHES, "side by side")],
)
def test_several_tables_in_one_file_are_told(tmp_path: Path, text: str, said: str) -> None:
    answer = nearlift("inspect", written.put(tmp_path, "a.csv", text.encode()))
    assert (answer.exit_code, said in answer.stderr) == (4, True), answer.stderr


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (("h (mm)", "30% (gf)", "50% (gf)"), ("percent", "gf")),
        (("Height [mm]", "Thrust 30 % [N]", "Thrust 50 % [N]"), ("percent", "N")),
        (("Abstand (mm)", "30 µs / mN", "50 µs / mN"), ("us", "mN")),
    ],
)
def test_lifts_side_by_side_become_a_row_each(
    tmp_path: Path, names: tuple[str, ...], units: tuple[str, str]
) -> None:
    path = written.put(tmp_path, "t.csv", f"{','.join(names)}\n20,1,2\n40,3,4\n".encode())
    rows, stated = proposed(path)
    assert rows == [
        "trial,distance,throttle,lift",
        "1,20,30,1",
        "2,40,30,3",
        "3,20,50,2",
        "4,40,50,4",
    ]
    assert (stated["throttle"], stated["lift"]) == units


def test_forces_of_a_record_are_no_table_of_means(tmp_path: Path) -> None:
    rows = "".join(f"{20 + i // 9},{i % 7},{i % 5}\n" for i in range(90))
    path = written.put(tmp_path, "t.csv", f"height (mm),F 1 (N),F 2 (N)\n{rows}".encode())
    assert inspect(path).table is None
