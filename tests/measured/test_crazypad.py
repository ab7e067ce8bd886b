"""CrazyPAD's flights: what near the ground and in hover they say of themselves, and the traps that
their logs hold.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.bench_campaign import run_ingest

from nearlift import catalogue
from nearlift.datasets import crazypad, registry
from nearlift.fit import closed_loop, hover
from nearlift.fit.closed_loop import BELIEVED
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.run.store import Table
from nearlift.stages import hovering
from nearlift.stages.flown import Determined
from nearlift.stages.observe import observe

DATA = Path(__file__).parents[3] / "shared" / "data" / "crazypad-2024"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the measured files of ../shared are not here"
)
FILES = {f.name: DATA / f.name.replace("-", "/") for f in registry.dataset("crazypad-2024").file}
SOUND = "normal_flight"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Table]:
    root = tmp_path_factory.mktemp("crazypad")
    crazypad.convert(FILES, root, "crazypad-2024")
    given = manifests.load(root)
    _, job = run_ingest(root, root / "out", given)
    return given, job.read(TRIALS)


def test_the_files_are_those_that_are_listed() -> None:
    for file in registry.dataset("crazypad-2024").file:
        content = FILES[file.name].read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (file.bytes, file.sha256)


def test_each_log_holds_two_flights_and_the_second_starts_from_zero(
    flown: tuple[Any, Table],
) -> None:
    """After the landing between them the height reads centimetres at rest: zero is set anew."""
    _, trials = flown
    good = trials["quality"] == ""
    for record in FILES:
        mine = good & (trials["record"] == record)
        assert set(trials["flight"][mine]) == {1.0, 2.0}
        for start in (1.0, 2.0):
            low = trials["z_m"][mine & (trials["flight"] == start)].min()
            # rotor plane 30 mm above feet that have left the floor, a brisk window higher at most
            assert 0.03 < low < 0.30


def test_take_offs_show_the_ground_and_no_coefficient(flown: tuple[Any, Table]) -> None:
    """By hand 9 % of lift at 2.25 radii, falling off exponentially by 0.7 per radius; K_b goes from
    0.5 to 4.8 with 50 mm of the rotor plane's height, which nobody measured.
    """
    given, trials = flown
    sound = {k: v[trials["condition"] == SOUND] for k, v in trials.items()}
    told = Determined(given, observe(sound, given, "ground"))
    found = told.determined()
    gain, decay = found["gain_at_2"], found["decay_length"]
    assert gain.lo90 < 0.09 * np.exp(0.7 * 0.25) < gain.hi90
    assert decay.lo90 < 1 / 0.7 < decay.hi90
    assert gain.lo90 > 0.02
    for c in found.values():
        assert "since no set-point was logged" in c.holds
    model = catalogue.model("sanchez_cuevas")
    plain = replace(gain, unit="1")
    assert told.coefficients(model, {"K_b": plain})["K_b"].refused


def test_every_form_and_power_settles_without_any_start(flown: tuple[Any, Table]) -> None:
    """Steps that turn back and forth settle too: the gain is not refused for want of steps."""
    windows = sound_windows(flown)
    for start in (-1, 7):
        kept = windows.taken(windows.start != start)
        for power in (None, *closed_loop.POWERS):
            for form in closed_loop.FORMS:
                ratio = closed_loop.decaying(kept.z_hat, form)
                closed_loop.solve(kept, ratio, BELIEVED[0], power, BELIEVED)


def test_what_moves_the_gain_is_what_the_gain_is_without(flown: tuple[Any, Table]) -> None:
    given, trials = flown
    sound = {k: v[trials["condition"] == SOUND] for k, v in trials.items()}
    data = observe(sound, given, "ground")
    gain = Determined(given, data).determined()["gain_at_2"]
    window, start = gain.influence.trial, gain.influence.visit
    assert window is not None
    assert start is not None
    assert window.z_hat is not None
    # far from the ground no single window says much of it
    assert window.z_hat < 4
    log, number = start.id.split(", start ")
    whole = (
        data.trial == window.id,
        [
            t.startswith(f"{log}#") and f == float(number)
            for t, f in zip(data.trial, data.covariates["flight"], strict=True)
        ],
    )
    for out, shift in zip(whole, (window.shift, start.shift), strict=True):
        less = Determined(given, data.take(~np.array(out)))
        [(_, found), *_] = closed_loop.gains(less.windows)
        assert np.exp(found.theta[0]) - gain.value == pytest.approx(shift, abs=2e-3)


def sound_windows(flown: tuple[Any, Table]) -> closed_loop.Windows:
    given, trials = flown
    sound = {k: v[trials["condition"] == SOUND] for k, v in trials.items()}
    return Determined(given, observe(sound, given, "ground")).windows


def test_hover_names_what_stands_above_its_limits_and_nothing_else(
    flown: tuple[Any, Table],
) -> None:
    found = {h.logs: h for h in hovering.compared(*flown, "ground")}
    named = {h.condition for h in found.values() if h.effects}
    assert named == {"cut_propeller_M3_3mm", "add_weight_W1_near_M3_M4"}
    for h in found.values():
        assert h.effects in ((), ("rotor_imbalance",))
        assert h.rivals == (("weight_at_rotor",) if h.effects else ())
    [cut] = [h for h in found.values() if h.condition == "cut_propeller_M3_3mm"]
    assert [s.rotor for s in cut.shifts if s.stands_out] == [3]


def test_a_normal_flight_has_no_name_in_eleven_of_twelve(flown: tuple[Any, Table]) -> None:
    own, conditions = hovering.means(flown[1], "ground")
    normal = [r for r in own if conditions[r] == SOUND]
    clean = 0
    for r in normal:
        others = np.array([own[q] for q in normal if q != r])
        for start in (0, 1):
            one = slice(start, start + 1)
            told = hover.shifts(own[r][None, one], others[:, one], 0.05)
            clean += not any(s.stands_out for s in told)
    assert len(normal) == 6
    assert clean >= 11
