"""`make measured`: the arithmetic of its variants, its outcomes, and one campaign from fetch to
row. The campaign is made up, and served on this machine.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from measured.__main__ import main
from measured.campaigns import CAMPAIGNS
from measured.injections import Case
from measured.loop import Finding
from tests.datasets.test_datasets import Server, listed

from measured import injections, page
from nearlift.datasets import pitt_ras_older, registry
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
    for cm in (5, 7.5, 12, 20, 60):
        for pwm, rpm, lift in (
            (1200, 2500, 4),
            (1350, 3300, 7),
            (1500, 4000, 11),
            (1650, 4700, 15),
        ):
            speed = 1 + 0.02 * rng.standard_normal()
            ratio = 1 / (1 - (12.7 / cm) ** 2 / 16)
            force = lift * ratio * speed**exponent * (1 + 0.003 * rng.standard_normal())
            lines.append(
                f"measurement,ground,10,{cm},{pwm},{rpm * speed:.1f},{rpm * speed:.1f},{force:.4f}"
            )
    return "\n".join(lines) + "\n"


@pytest.fixture
def server(tmp_path):
    (tmp_path / "published").mkdir()
    running = Server(tmp_path / "published")
    yield running
    running.stop()


def publish(server: Server, tmp_path: Path, text: str) -> None:
    """Serve a table, and list it as a data set."""
    own = listed(server, {"packet.csv": text}, tmp_path / "list.toml", converter="jirs")
    own.write_text(own.read_text().replace('"made-up"', f'"{NAME}"'))


def command(tmp_path: Path, *words: str, data: str = "none") -> int:
    options = {
        "--registry": tmp_path / "list.toml",
        "--cache": tmp_path / "cache",
        "--data": tmp_path / data,
        "--out": tmp_path / "out",
    }
    return main([str(w) for option in options.items() for w in option] + [*words])


def test_one_line_fetches_a_campaign_and_makes_a_row(server, tmp_path, capsys):
    publish(server, tmp_path, table(exponent=2.0))
    case = ("--case", NAME, "zero_offset", "1")
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
    case = ("--case", NAME, "published")
    assert command(tmp_path, *case) == 4
    assert "cannot be fetched" in capsys.readouterr().err
    assert command(tmp_path, *case, data="published") == 0
    shown = capsys.readouterr()
    assert f"{NAME}: 1 files from {server.folder}" in shown.err
    assert "adequate" in shown.out


def test_every_campaign_of_the_page_is_a_data_set():
    names = [d.name for d in registry.datasets()]
    assert {c.name for c in CAMPAIGNS} <= set(names)
    assert set(injections.WITHHELD) <= set(names)


ROWS = [
    {"trial": f"t{i}", "distance": "5", "throttle": "50", "lift": f"{2 + i % 3}", "session": s}
    for i, s in enumerate("aabbcc")
]


@pytest.mark.parametrize("kind", [k for k in injections.KINDS if k != "height_offset"])
def test_an_injection_has_its_rms(kind):
    rows = injections.logged(ROWS, "seed", 0.01)
    changed = injections.injected(rows, Case("x", kind, 2.0), 0.02, 10.0)
    before, after = (np.array([float(r["lift"]) for r in x]) for x in (rows, changed))
    change = after / before - 1
    assert np.sqrt(np.mean(change**2)) == pytest.approx(0.04, rel=1e-6)
    if kind == "zero_offset":
        np.testing.assert_allclose(after - before, (after - before)[0], rtol=1e-5)
    if kind == "session_gain":
        np.testing.assert_allclose(change[::2], change[1::2], rtol=1e-5)
    if kind == "gain_drift":
        np.testing.assert_allclose(np.diff(change), np.diff(change)[0], rtol=1e-5)
    if kind == "supply_sag":
        volts = np.log([float(r["supply"]) for r in rows])
        assert np.corrcoef(change, volts)[0, 1] == pytest.approx(1, abs=1e-3)


def test_a_height_offset_changes_the_recorded_distance_only():
    changed = injections.injected(ROWS, Case("x", "height_offset", 1.0), 0.02, 10.0)
    assert {r["distance"] for r in changed} == {"5.1"}
    assert [r["lift"] for r in changed] == [r["lift"] for r in ROWS]


def test_a_synthetic_voltage_has_the_rms_that_is_asked_for():
    volts = [float(r["supply"]) for r in injections.logged(ROWS, "seed", 0.01)]
    assert np.std(np.log(volts)) == pytest.approx(0.01, rel=1e-3)
    kept = injections.logged([{**r, "supply": "24"} for r in ROWS], "seed", 0.01)
    assert {r["supply"] for r in kept} == {"24"}


def test_a_withheld_cause_leaves_trials_and_manifest(tmp_path):
    (tmp_path / "campaign.toml").write_text(
        'name = "x"\n[trials.units]\ndistance = "cm"\ntilt = "deg"\n'
    )
    (tmp_path / "trials.csv").write_text("trial,distance,tilt,beta,lift\na,5,10,20,3\n")
    case = Case("garofano-soldado-2023", "withheld")
    made = injections.written(case, tmp_path, tmp_path / "made", 0.0)
    assert (made / "trials.csv").read_text() == "trial,distance,lift\na,5,3\n"
    manifest = (made / "campaign.toml").read_text()
    assert f'name = "{case.name}"' in manifest
    assert "tilt" not in manifest


def finding(verdict: str, *effects: tuple[str, tuple[str, ...]]) -> Finding:
    return Finding(
        verdict=verdict,
        effects=effects,
        before=(0.02, 0.01, 0.03),
        after=None,
        floor=0.01,
        coefficient="k",
        number=(1.0, 0.9, 1.1),
    )


@pytest.mark.parametrize(
    ("found", "without", "expected"),
    [
        (finding("effect", ("gain_drift", ())), finding("adequate"), "found"),
        (finding("effect", ("warm_up", ("gain_drift",))), finding("adequate"), "found"),
        (finding("effect", ("warm_up", ())), finding("adequate"), "false"),
        (finding("effect", ("tilt", ())), finding("effect", ("tilt", ())), "missed"),
        (finding("unexplained"), finding("adequate"), "abstained"),
        (finding("adequate"), finding("adequate"), "missed"),
    ],
)
def test_outcomes(found, without, expected, tmp_path):
    assert injections.outcome(Case("x", "gain_drift", 2.0), found, without) == expected
    found.save(tmp_path / "kept" / "x.json")
    assert Finding.load(tmp_path / "kept" / "x.json") == found


def test_rows_are_reproducible_by_their_command(tmp_path):
    case = Case("jirs2024-ceiling-12-inch", "gain_drift", 2.0)
    pair = (case, finding("unexplained"), finding("adequate"))
    page.write_rows(tmp_path / "rows.csv", [pair])
    [row] = csv.DictReader((tmp_path / "rows.csv").open())
    assert row["outcome"] == "abstained"
    assert row["command"] == f"python -m measured --case {case.campaign} gain_drift 2"
    text = page.injections([pair])
    assert "| `gain_drift` | 2 | 0 | 0 | 0 | 1 |" in text


def test_older_sweeps_are_read_from_their_script(tmp_path):
    script = tmp_path / "fit.py"
    script.write_text(
        "data = (\n#     np.array((\n#             (470,2011,12.5,1.5),\n#         )),\n"
        "    np.array((\n            (15,1220,12.4,1.5),\n            (9,1100,12.4,1.5),\n        )),\n"
        "    np.array((\n            (27,1320,12.1,0.2),\n        )))\n"
    )
    pitt_ras_older.convert({"fit.py": script}, tmp_path, "older")
    assert (tmp_path / "trials.csv").read_text().splitlines()[1:] == [
        "s1-00,1.5,0.2,15,12.4,1",
        "s2-02,0.2,0.290909,27,12.1,2",
    ]
