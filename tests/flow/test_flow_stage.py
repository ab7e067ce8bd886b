"""The stage on files: known downwash comes back, bad input is reported, it runs if configured."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run

from nearlift.campaign import manifest as manifests
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.piv import files_of
from nearlift.run import engine
from nearlift.stages import flow
from nearlift.stages.flow import (
    DOWNWASH,
    DOWNWASH_PROFILE,
    FLOW,
    FLOW_FIELDS,
    FLOW_PRODUCTS,
    FLOW_TOPOLOGY,
)
from nearlift.synthetic import demo_flow
from nearlift.synthetic.records import SimulatedBench

from .conftest import HEAD, Made, job

NEW = "# x\ty\tu\tv\tflags\tmask\n"


def test_the_true_reductions_lie_in_their_intervals(wakes: Made):
    """Fourteen 90 % intervals with 8 fields each: fewer than 7 hits have a chance of 1 in 2000 even
    at 0.85.
    """
    table = wakes.job.read(DOWNWASH)
    true = demo_flow.wakes(SimulatedBench())
    control = true["control"].downwash_m_s(demo_flow.CUT_M, 0.023, (0.0325,))
    hits = total = 0
    for i in np.flatnonzero(table["rotor"] == "all"):
        name = table["case"][i]
        if name == "control" or not np.isfinite(table["reduction"][i]):
            continue
        rotors = (-0.0325, 0.0325) if name.startswith("tilt") else (0.0325,)
        less = 1 - true[name].downwash_m_s(demo_flow.CUT_M, 0.023, rotors) / control
        hits += table["reduction_lo90"][i] < less < table["reduction_hi90"][i]
        total += 1
    assert total == 14
    assert hits >= 7


def test_a_measured_half_is_reflected_and_marked(wakes: Made):
    profile = wakes.job.read(DOWNWASH_PROFILE)
    mine = profile["case"] == "ground-3.4"
    x, v, marked = (profile[n][mine] for n in ("x_m", "downwash_m_s", "mirrored"))
    np.testing.assert_allclose(x, -x[::-1], atol=1e-12)
    np.testing.assert_allclose(v, v[::-1])
    np.testing.assert_array_equal(marked == 1, x < -1e-9)
    rotors = wakes.job.read(DOWNWASH)
    assert rotors["rotor"][rotors["case"] == "ground-3.4"].tolist() == ["1", "all"]
    assert rotors["rotor"][rotors["case"] == "tilt+4.6"].tolist() == ["0", "1", "all"]
    document = wakes.job.read_json(FLOW)
    assert document["cases"]["ground-3.4"]["mirrored"]
    assert not document["cases"]["tilt+4.6"]["mirrored"]


def test_what_was_masked_and_what_lies_behind_the_ground_has_no_vectors(wakes: Made):
    fields = wakes.job.read(FLOW_FIELDS)
    behind = fields["z_m"] <= 0
    assert behind.any()
    assert np.isnan(fields["vx_m_s"][behind]).all()
    body = (np.abs(fields["x_m"]) < 0.04) & (np.abs(fields["y_m"] + 0.002) < 0.003)
    assert np.isnan(fields["vy_m_s"][body]).all()


def test_topology_has_a_row_for_each_ground_case(wakes: Made):
    table = wakes.job.read(FLOW_TOPOLOGY)
    assert len(table["case"]) == 10
    row = {name: list(table["case"]).index(name) for name in table["case"]}
    for name in ("tilt+4.6", "tilt+3.1"):
        assert table["vortices_ccw"][row[name]] == table["vortices_cw"][row[name]] == 2
    assert table["jets"][row["tilt+4.6"]] == "two jets, leaning right"
    # one half was measured, the other is its reflection
    assert table["jets"][row["ground-3.4"]] == ""
    fields = wakes.job.read(FLOW_FIELDS)
    assert fields["stagnant"][fields["case"] == "ground-3.4"].any()


def test_a_cut_near_the_ground_is_noted(wakes: Made):
    notes = [n for n in wakes.outcome.notes if n.startswith("the cut is within one rotor diameter")]
    assert any("ground-1.8" in n for n in notes)
    assert not any("ground-3.4" in n for n in notes)


def test_the_demo_has_the_paper_s_reductions_and_its_growing_stagnation_zone(wakes: Made):
    """6 % at 3.4 radii above the ground and 22 % at 2 below the ceiling; the zone grows as the
    vehicle comes down.
    """
    table = wakes.job.read(DOWNWASH)
    whole = {
        name: value
        for name, rotor, value in zip(
            table["case"], table["rotor"], table["reduction"], strict=True
        )
        if rotor == "all"
    }
    assert whole["ground-3.4"] == pytest.approx(0.06, abs=0.03)
    assert whole["ceiling-2"] == pytest.approx(0.22, abs=0.03)
    flow_table = wakes.job.read(FLOW_TOPOLOGY)
    area = dict(zip(flow_table["case"], flow_table["stagnation_area_hat2"], strict=True))
    zones = [area[f"ground-{z}"] for z in ("4", "3.4", "2.6", "1.8")]
    assert (np.diff(zones) > 0).all()


def test_running_twice_gives_the_same_bytes(wakes: Made, tmp_path):
    again = job(wakes.job.root, tmp_path)
    flow.run(again)
    for product in FLOW_PRODUCTS:
        assert (again.processed / product.file).read_bytes() == (
            wakes.job.processed / product.file
        ).read_bytes()


# ---- spoilt files


@pytest.fixture
def two(wakes: Made, tmp_path) -> Path:
    """A campaign of control and one ground case, to spoil."""
    for name in ("control", "ground-4"):
        shutil.copytree(wakes.job.root / "piv" / name, tmp_path / "piv" / name)
    text = (wakes.job.root / "campaign.toml").read_text()
    blocks = text.split("\n[[piv.case]]\n")
    kept = [b for b in blocks[1:] if 'name = "control"' in b or 'name = "ground-4"' in b]
    head = "\n".join(line for line in blocks[0].split("\n") if not line.startswith("figure3"))
    (tmp_path / "campaign.toml").write_text("\n[[piv.case]]\n".join([head, *kept]))
    return tmp_path


def edit(root: Path, old: str, new: str) -> None:
    path = root / "campaign.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def rewrite(path: Path, change) -> None:
    """Change the rows of a file, or of all files of a folder."""
    for one in path.iterdir() if path.is_dir() else (path,):
        rows = np.loadtxt(one)
        change(rows)
        one.write_text(NEW + "\n".join("\t".join(f"{v:.6g}" for v in row) for row in rows) + "\n")


def zeros(rows: np.ndarray) -> None:
    rows[:, 2:4] = 0


def test_a_file_of_zeros_is_left_out_with_its_reason(two):
    rewrite(two / "piv/control/0003.txt", zeros)
    made = job(two, two)
    outcome = flow.run(made)
    assert outcome.notes == ("control: piv/control/0003.txt left out: every vector is zero",)
    facts = made.read_json(FLOW)["cases"]["control"]
    assert (facts["files"], facts["fields"], len(facts["left_out"])) == (8, 7, 1)


def faster(rows: np.ndarray) -> None:
    rows[:, 2:4] *= 1e3


@pytest.mark.parametrize(
    ("case", "change", "says"),
    [
        ("control", zeros, "every vector is zero"),
        ("ground-4", faster, "mm/s written as m/s"),
    ],
)
def test_a_case_that_cannot_be_is_refused(two, case, change, says):
    rewrite(two / "piv" / case, change)
    with pytest.raises(InputRefused, match=says):
        flow.run(job(two, two))


def test_v_sign_corrects_a_flipped_component_and_thrust_an_inverted_vehicle(two):
    made = job(two, two)
    assert flow.run(made).notes == ()
    plain = made.read(DOWNWASH)["reduction"]
    rewrite(two / "piv/ground-4", lambda r: r.__setitem__((slice(None), 3), -r[:, 3]))
    edit(two, 'name = "ground-4"', 'name = "ground-4"\nv_sign = -1')
    flow.run(job(two, two))
    np.testing.assert_allclose(made.read(DOWNWASH)["reduction"], plain, atol=1e-4)
    # hung upside down: the picture turned by half a turn, files as the camera wrote them
    rewrite(two / "piv/ground-4", lambda r: (r.__setitem__((slice(None), slice(0, 3)), -r[:, :3]),))
    edit(two, "v_sign = -1", 'thrust = "-y"\nacross = "-x"')
    flow.run(job(two, two))
    np.testing.assert_allclose(made.read(DOWNWASH)["reduction"], plain, atol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            'control = "control"',
            'control = "free"',
            "there is no case 'free'; cases are control, ground-4",
        ),
        (
            'control = "control"',
            'control = "ground-4"',
            "the control 'ground-4' must have boundary = \"none\"",
        ),
        ('thrust = "+y"', "", "case 'control': thrust is missing"),
        ('origin = ["0 mm", "0 mm"]', "origin = [0, 0]", "has no unit"),
        ("z_hat = 4", "", "needs z_hat"),
        ('boundary = "none"', 'boundary = "none"\nz_hat = 3', "has no distance: leave z_hat out"),
        ('name = "ground-4"', 'name = "control"', "two cases have the same name: control"),
        ('thrust = "+y"', 'thrust = "+y"\nacross = "+y"', "across and thrust are the same axis"),
        (
            'length_unit = "mm"',
            'scale = "20 um"',
            'is no length per px, as "20 um/px" is',
        ),
        ('rate = "15 Hz"', 'rates = "15 Hz"', "unknown key; did you mean 'rate'"),
    ],
)
def test_a_manifest_that_cannot_be_is_refused(two, old, new, says):
    edit(two, old, new)
    with pytest.raises(ManifestError, match=says):
        manifests.load(two)


def test_patterns_stay_in_the_folder_and_match_something(two):
    edit(two, "piv/ground-4/*.txt", "piv/nothing/*.txt")
    with pytest.raises(ManifestError, match="no file matches"):
        flow.run(job(two, two))
    edit(two, "piv/nothing/*.txt", "../*.txt")
    with pytest.raises(ManifestError, match="leads outside"):
        flow.run(job(two, two))


def test_files_come_in_the_order_of_their_numbers(two):
    for n in ("b10.txt", "b9.txt", "b1.txt"):
        (two / "piv" / n).write_text("x")
    edit(two, "piv/ground-4/*.txt", "piv/b*.txt")
    made = job(two, two)
    assert [p.name for p in files_of(two, made.campaign.piv.named("ground-4"))] == [
        "b1.txt",
        "b9.txt",
        "b10.txt",
    ]


# ---- in the graph


def test_a_campaign_without_grids_has_no_flow_stage_and_says_so_when_asked(tmp_path):
    (tmp_path / "campaign.toml").write_text(HEAD)
    with pytest.raises(ManifestError, match=r"piv: is missing\n  list velocity grids"):
        flow.run(job(tmp_path, tmp_path))


@pytest.mark.nightly
def test_flow_runs_with_the_others_and_what_reads_it_heeds_the_grids(two, tmp_path, monkeypatch):
    monkeypatch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
    raw = small_run.write(tmp_path / "raw")
    shutil.copytree(two / "piv", raw / "piv")
    text = (two / "campaign.toml").read_text()
    path = raw / "campaign.toml"
    path.write_text(path.read_text() + "\n" + text[text.index("[piv]") :])
    ran = small_run.ran(small_run.job(raw, tmp_path))
    others = {"ingest", "reduce", "fit"}
    assert others | {"flow", "diagnose", "report"} <= set(ran)
    assert ran.index("flow") < ran.index("report")
    assert (tmp_path / "reports/small/fig3.png").is_file()
    drawn = list(csv.DictReader((tmp_path / "reports/small/downwash.csv").read_text().splitlines()))
    measured = [r for r in drawn if r["kind"] == "measured"]
    assert measured
    assert all(float(r["lo90_percent"]) < float(r["hi90_percent"]) for r in measured)
    assert {r["label"] for r in drawn if r["kind"] == "model"} <= {"C-B (theory)", "S-C, quoted"}
    page = (tmp_path / "reports/small/index.html").read_text()
    assert 'id="flow"' in page
    assert "SIMULATED fields, no measurement" in page
    assert small_run.ran(small_run.job(raw, tmp_path)) == []
    rewrite(
        raw / "piv/ground-4", lambda r: r.__setitem__((slice(None), slice(2, 4)), 0.9 * r[:, 2:4])
    )
    again = set(small_run.ran(small_run.job(raw, tmp_path)))
    assert {"flow", "diagnose", "report"} <= again
    assert not others & again
    ledger = json.loads((tmp_path / "processed/small/provenance.json").read_text())
    assert "[piv] ground-4 (8 files)" in ledger["inputs"]
    assert small_run.nearlift("run", "--check", raw, "--out", tmp_path).exit_code == 0
    first, last = (sorted((raw / "piv/ground-4").iterdir())[i] for i in (0, -1))
    whole = first.read_bytes()
    first.write_bytes(whole[:-1] + b" ")
    assert (
        "[piv] ground-4 (8 files): is not what it was"
        in small_run.nearlift("run", "--check", raw, "--out", tmp_path).stdout
    )
    first.write_bytes(whole)
    last.rename(tmp_path / last.name)
    assert (
        "[piv] ground-4 (8 files): is missing"
        in small_run.nearlift("run", "--check", raw, "--out", tmp_path).stdout
    )
    (tmp_path / last.name).rename(last)
    (raw / "campaign.toml").write_text(path.read_text()[: path.read_text().index("[piv]")])
    left = {s.name: why for s, why in engine.plan(small_run.job(raw, tmp_path))}
    assert "flow" not in left
    assert left["diagnose"] == "[piv] of the manifest has changed"
    assert left["report"]
    assert not any(left[name] for name in others)
