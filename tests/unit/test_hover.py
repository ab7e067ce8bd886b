"""What hover says of a defect: flights of one condition against sound ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.calibration import flying
from tests.calibration.flying import FLIGHT, Craft
from tests.unit.bench_campaign import run_ingest

from nearlift.errors import InputRefused
from nearlift.fit.hover import shifts
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.report.chapters.verdict import hovering as hovering_told
from nearlift.results.hover import HoverComparison
from nearlift.results.serial import decode, encode
from nearlift.run.store import Table
from nearlift.stages import hovering

RATE = 0.05


def logs(rng: np.random.Generator, count: int) -> Any:
    """Log voltages of two starts and four rotors: rotors scatter unlike each other from log to log,
    and the second start differs from the first.
    """
    own = rng.normal(0, [0.01, 0.05, 0.02, 0.02], (count, 1, 4)) + rng.normal(
        0, 0.01, (count, 1, 1)
    )
    return own + np.array([[[0.0], [0.02]]]) + rng.normal(0, 0.002, (count, 2, 4))


def test_sound_flights_are_found_different_as_often_as_stated() -> None:
    """Bonferroni's bound, four standard errors of 1500 campaigns wide; and not idle."""
    rng = np.random.default_rng(11)
    n = 1500
    found = [shifts(logs(rng, 3), logs(rng, 6), RATE) for _ in range(n)]
    share = np.mean([any(s.stands_out for s in f) for f in found])
    assert 0.2 * RATE < share < RATE + 4 * np.sqrt(RATE * (1 - RATE) / n)


def test_a_missing_start_is_compared_with_starts_of_its_number() -> None:
    rng = np.random.default_rng(12)
    sound = logs(rng, 6)
    one = sound.mean(axis=0)[None].copy()
    one[:, 1] = np.nan
    assert [s.value for s in shifts(one, sound, RATE)] == pytest.approx([0] * 5, abs=1e-12)


def test_one_rotor_has_no_others() -> None:
    found = shifts(np.full((1, 1, 1), 0.1), np.array([0.0, 0.01, -0.01, 0.0])[:, None, None], RATE)
    assert [s.value for s in found] == pytest.approx([0.1])


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Table]:
    """Six sound logs, two with a rotor that gives a sixth less, two with nothing wrong, and two
    that are told a tenth more throughout.
    """
    root = tmp_path_factory.mktemp("hover")
    (root / "logs").mkdir()
    rng, rows = np.random.default_rng(14), ["record,boundary,condition"]
    kinds = (("sound", 6, 1.0), ("cut", 2, 0.84), ("painted", 2, 1.0), ("laden", 2, 1.0))
    for condition, count, health in kinds:
        for k in range(count):
            craft = Craft(
                hover=Craft().hover * (1.1 if condition == "laden" else 1.0),
                health=(1.0, 1.0, health, 1.0),
                shares=tuple(np.array(Craft().shares) + rng.normal(0, 0.004, 4)),
            )
            log = flying.fly(craft, rng, np.array([0.3, 0.3, 0.25, 0.3]))
            flying.write_csv(root / "logs" / f"{condition}{k}.csv", log)
            rows.append(f"{condition}{k},ground,{condition}")
    (root / "trials.csv").write_text("\n".join(rows) + "\n")
    given = manifests.parse(flying.manifest({**FLIGHT, "sound": "sound", "lag": "75 ms"}))
    _, job = run_ingest(root, root / "out", given)
    return given, job.read(TRIALS)


def told(flown: tuple[Any, Table]) -> dict[str, HoverComparison]:
    return {h.logs[0]: h for h in hovering.compared(*flown, "ground")}


def test_a_worse_rotor_is_found_and_a_weight_is_its_rival(flown: tuple[Any, Table]) -> None:
    """In hover a weight at a rotor and a weaker rotor cannot be told apart: rivals, always."""
    cut = told(flown)["cut0"]
    assert (cut.effects, cut.rivals) == (("rotor_imbalance",), ("weight_at_rotor",))
    [third] = [s for s in cut.shifts if s.rotor == 3]
    # (1 / 0.84) ** (1 / 1.7), against three others
    assert third.stands_out
    assert third.value == pytest.approx(0.1026, abs=0.02)
    assert "cut (2 logs) against 6 sound logs differs in motor voltage: rotor 3 +" in cut.text


def test_what_is_as_sound_as_the_others_shows_nothing(flown: tuple[Any, Table]) -> None:
    found = told(flown)
    assert not found["painted0"].effects
    assert "shows nothing" in found["painted0"].text
    assert not any(found[f"sound{k}"].effects for k in range(6))
    assert found["sound0"].sound_logs == 5


def test_all_rotors_together_are_a_mass_or_a_gain_of_the_session(flown: tuple[Any, Table]) -> None:
    laden = told(flown)["laden0"]
    assert (laden.effects, laden.rivals) == (("vehicle_mass",), ("session_gain",))
    assert [s.rotor for s in laden.shifts if s.stands_out] == [0]
    # log 1.1; the battery sags further
    assert laden.shifts[0].value == pytest.approx(0.095, abs=0.02)


def test_the_page_tells_what_is_found_and_what_shows_nothing(flown: tuple[Any, Table]) -> None:
    given, trials = flown
    cut, laden, painted = hovering_told(hovering.compared(given, trials, "ground"), given.flight)
    assert cut.startswith("in hover cut (2 logs) against 6 sound logs differs in motor voltage")
    assert "all rotors +" in laden
    assert painted == "in hover painted shows nothing"
    two = [h for h in told(flown).values() if not h.effects and h.condition != "sound"] * 2
    assert hovering_told(two, given.flight) == ["in hover painted and painted show nothing"]


def test_hover_without_a_comparison_is_refused(flown: tuple[Any, Table]) -> None:
    given, trials = flown
    without = {k: v for k, v in trials.items() if k != "condition"}
    with pytest.raises(InputRefused, match=r"no column 'condition', and flight.sound = 'sound'"):
        hovering.compared(given, without, "ground")
    few = {k: v[trials["record"] < "sound3"] for k, v in trials.items()}
    with pytest.raises(InputRefused, match="3 logs whose condition is 'sound' hover far"):
        hovering.compared(given, few, "ground")
    silent = given.model_copy(update={"flight": given.flight.model_copy(update={"sound": None})})
    assert not hovering.compared(silent, trials, "ground")


def test_what_was_found_is_read_back_from_its_file(flown: tuple[Any, Table]) -> None:
    found = told(flown)["cut0"]
    assert decode(HoverComparison, encode(found)) == found
