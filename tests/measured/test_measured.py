"""`make measured`: the arithmetic of its variants, its outcomes, and one campaign from fetch to
row. The campaign is made up, and served on this machine.
"""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from measured.__main__ import main
from measured.campaigns import REMARKS
from measured.variants import STORED, Case, Finding
from tests.datasets.published import PublishedFolder, listed, published

from measured import page, variants
from nearlift.datasets import registry
from nearlift.randomness import generator

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
NAME = "made-up-ground-10-inch"


def table(*, exponent: float = 0.0) -> str:
    """Twenty means over a ground (k = 1), 0.3 % of scatter, whose rotors turn a little differently
    in each; lift has that exponent of speed.
    """
    rng = generator(3, "table")
    lines = ["row_type,effect,prop_diameter_in,distance_cm,pwm,rpm_1,rpm_mean,fz_n"]
    steps = ((1200, 2500, 4), (1350, 3300, 7), (1500, 4000, 11), (1650, 4700, 15))
    for cm, (pwm, rpm, lift) in itertools.product((5, 7.5, 12, 20, 60), steps):
        speed = 1 + 0.02 * rng.standard_normal()
        ratio = 1 / (1 - (12.7 / cm) ** 2 / 16)
        force = lift * ratio * speed**exponent * (1 + 0.003 * rng.standard_normal())
        turned = f"{rpm * speed:.1f}"
        lines.append(f"measurement,ground,10,{cm},{pwm},{turned},{turned},{force:.4f}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def server(tmp_path, monkeypatch):
    monkeypatch.setenv("NEARLIFT_CACHE", str(tmp_path / "cache"))
    with published(tmp_path / "published") as running:
        yield running


def publish(server: PublishedFolder, tmp_path: Path, text: str) -> None:
    """Serve a table, and list it as a data set."""
    own = listed(server, {"packet.csv": text}, tmp_path / "list.toml", converter="jirs")
    own.write_text(own.read_text().replace('"made-up"', f'"{NAME}"'))


def command(tmp_path: Path, *case: str, data: str = "none") -> int:
    places = {"--registry": "list.toml", "--data": data, "--out": "out"}
    options = [x for option, name in places.items() for x in (option, str(tmp_path / name))]
    return main([*options, "--case", NAME, *case])


def test_one_line_fetches_a_campaign_and_makes_a_row(server, tmp_path, capsys):
    publish(server, tmp_path, table(exponent=2.0))
    case = ("zero_offset", "1")
    assert command(tmp_path, *case) == 0
    with_it, _, without, _, outcome = capsys.readouterr().out.splitlines()
    assert "rotor_speed" in with_it
    assert "rotor_speed" in without
    assert outcome in page.OUTCOMES
    assert (tmp_path / "cache" / NAME / "packet.csv").is_file()
    # all is kept: a second call needs no network
    server.stop()
    assert command(tmp_path, *case) == 0
    assert capsys.readouterr().out.splitlines()[-1] == outcome


def test_without_a_network_files_at_hand_serve_or_the_command_says_so(server, tmp_path, capsys):
    publish(server, tmp_path, table())
    server.stop()
    assert command(tmp_path, "published") == 4
    assert "cannot be fetched" in capsys.readouterr().err
    assert command(tmp_path, "published", data="published") == 0
    shown = capsys.readouterr()
    assert f"{NAME}: packet.csv from {server.folder}" in shown.err
    assert "adequate" in shown.out


def test_every_campaign_of_the_page_is_a_data_set():
    names = registry.datasets()
    assert {*REMARKS, *variants.WITHHELD} <= set(names)


TRIALS = pd.DataFrame(
    {
        "trial": [f"t{i}" for i in range(6)],
        "distance": 5.0,
        "throttle": 50,
        "lift": [2.0, 3.0, 4.0, 2.0, 3.0, 4.0],
        "session": list("aabbcc"),
    }
)
MANIFEST = """name = "x"
[trials]
order = "unknown"
[trials.units]
distance = "cm"
tilt = "deg"
"""


def variant(case: Case, folder: Path, table: pd.DataFrame, floor: float = 0.02) -> pd.DataFrame:
    """Trials of a variant, by way of files."""
    (folder / "campaign.toml").write_text(MANIFEST)
    table.to_csv(folder / "trials.csv", index=False)
    variants.write(case, folder, folder / "made", floor)
    return pd.read_csv(folder / "made" / "trials.csv").set_index("trial").loc[table["trial"]]


@pytest.mark.parametrize("kind", variants.KINDS)
def test_an_injection_has_its_rms(kind, tmp_path):
    made = variant(Case("x", kind, 2.0), tmp_path, TRIALS)
    lift = TRIALS["lift"].to_numpy()
    change = made["lift"].to_numpy() / lift - 1
    if kind == "height_offset":
        np.testing.assert_allclose(made["distance"], 5.2)
        assert (change == 0).all()
        return
    assert np.sqrt(np.mean(change**2)) == pytest.approx(0.04, rel=1e-6)
    # the same unit size at another one
    if kind == "zero_offset":
        np.testing.assert_allclose(change * lift, (change * lift)[0])
    if kind == "session_gain":
        np.testing.assert_allclose(change[::2], change[1::2])
    if kind == "gain_drift":
        start = made["start"].to_numpy()
        np.testing.assert_allclose(change, np.polyval(np.polyfit(start, change, 1), start))
    if kind == "supply_sag":
        volts = np.log(made["supply"])
        assert np.corrcoef(change, volts)[0, 1] == pytest.approx(1)
        # as a lift in proportion to voltage squared has it
        assert volts.std(ddof=0) == pytest.approx(0.02)


def test_what_the_lab_logged_is_kept_and_a_withheld_cause_leaves_trials_and_manifest(tmp_path):
    made = variant(Case("x"), tmp_path, TRIALS.assign(supply=24, start=range(6)))
    assert set(made["supply"]) == {24}
    assert made["start"].tolist() == [*range(6)]
    case = Case("garofano-soldado-2023", "withheld")
    made = variant(case, tmp_path, TRIALS.assign(tilt=10, beta=20))
    assert made.columns.tolist() == TRIALS.columns[1:].tolist()
    manifest = (tmp_path / "made" / "campaign.toml").read_text()
    assert f'name = "{case.name}"' in manifest
    assert "tilt" not in manifest


def finding(verdict: str, *effects: str) -> Finding:
    return Finding(
        verdict=verdict,
        explanations=tuple((e,) for e in effects),
        probability=0.9,
        before=(0.02, 0.01, 0.03),
        after=None,
        floor=0.01,
        coefficient="k",
        number=(1.0, 0.9, 1.1),
    )


@pytest.mark.parametrize(
    ("answer", "without", "expected"),
    [
        (finding("effect", "gain_drift"), finding("adequate"), "found"),
        (finding("effect", "warm_up", "gain_drift"), finding("adequate"), "found"),
        (finding("effect", "warm_up"), finding("adequate"), "false"),
        (finding("effect", "tilt"), finding("effect", "tilt"), "missed"),
        (finding("unexplained"), finding("adequate"), "abstained"),
        (finding("adequate"), finding("adequate"), "missed"),
    ],
)
def test_outcomes(answer, without, expected):
    assert variants.outcome(Case("x", "gain_drift", 2.0), answer, without) == expected
    assert STORED.validate_json(STORED.dump_json(answer)) == answer


def test_rows_are_reproducible_by_their_command(tmp_path, monkeypatch):
    case = Case("jirs2024-ceiling-12-inch", "gain_drift", 2.0)
    pair = page.Pair(case, finding("unexplained"), finding("adequate"))
    page.write_rows(tmp_path / "rows.csv", [pair])
    [row] = csv.DictReader((tmp_path / "rows.csv").open())
    assert row["outcome"] == "abstained"
    assert row["command"] == f"python -m measured --case {case.campaign} gain_drift 2"
    assert "| `gain_drift` | 2 | 0 | 0 | 0 | 1 |" in page.injections([pair])
    assert f"| {case.campaign} | adequate, 90 % | 0 | 0 | 0 | 1 | 1 of 1 |" in page.coverage([pair])
    # no campaign is measured here, so their figure is that of the injections
    monkeypatch.setattr(page, "draw_errors", lambda _: page.draw([pair]))
    page.write(tmp_path, [], [pair])
    assert case.campaign in (tmp_path / "measured.md").read_text()
    for name in ("errors", "injections"):
        assert (tmp_path / f"figures/measured-{name}.png").stat().st_size > 5000
