"""The tables of a manifest, written by tomlkit: what no file says is marked FILL IN."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import tomlkit
from tomlkit import TOMLDocument
from tomlkit.items import InlineTable, Table

from nearlift import units
from nearlift.campaign.manifest import BLANK
from nearlift.onboarding import meaning
from nearlift.onboarding.inspection import Inspection, rows_per_stamp, usual_head
from nearlift.onboarding.tables import ProposedSchedule
from nearlift.printing import printable
from nearlift.readers.base import AS_FORCE, FORCE_UNITS
from nearlift.schedule import BY_NAME, RADII

FACTS = """\
# Facts about the rig, and choices. A quantity is a text with a unit. Nothing physical has a default.
schema = "nearlift.campaign/1"
name   = "campaign"                  # names the folders under processed/ and reports/: a-z, 0-9, '-', '_', '.'

[vehicle]
name          = "FILL IN"
rotors        = "FILL IN"            # a number, without quotes; 1: an isolated rotor
rotor_radius  = "FILL IN mm"
rotor_spacing = "FILL IN mm"         # between ADJACENT axes; the opposite spacing is sqrt(2) times it, unless rotor_diagonal is given; one rotor: delete
mass          = "FILL IN g"
contact       = { ground = "FILL IN mm", ceiling = "FILL IN mm" }   # distance at which the vehicle first touches, measured as `distance` is: what counts as a crash; not flown: delete
# motor_lag = "60 ms"                # of simulated flights: time constant of thrust after a command; thrust_limit = "0.55 N", else the largest lift measured
# throttle_map = { points = [["25 percent", "10885 rpm"], ["92 percent", "23500 rpm"]] }   # for C_L, where no rpm is logged

[rig]
held            = "FILL IN"          # throttle | voltage | rpm | power: the quantity that is constant during a trial
distance_datum  = "FILL IN"          # rotor plane | airframe | blade tip | rotor axis: the point that `distance` is measured from
distance_offset = "FILL IN mm"       # from the datum to the rotor plane, ADDED to every recorded distance
gravity         = "FILL IN m/s^2"    # the standard value is 9.80665 m/s^2
arena           = "FILL IN m"        # largest dimension of the room: no distance is larger; unknown: delete
"""
CELL = """\
[load_cell]
sample_rate = "FILL IN Hz"
tare        = "FILL IN s"            # head of every record with the rotors at rest, with a margin before they start; "0 s": already tared; "none": unknown zero
settle      = "0 s"                  # left out after the tare, until the lift is steady
range       = "FILL IN kgf"          # force at which the cell saturates; unknown: delete
accuracy    = "FILL IN gf"           # half-width of the departure from a straight line; does not average out; unknown: delete
"""
RECORDS = """\
[records]
reader = "csv"                       # csv: one file per trial | parquet: one long table with a `trial` column | means: no records
files  = "trials/{trial}.csv"
force  = { column = "FILL IN", unit = "FILL IN", sign = 1 }   # sign = -1 where lift makes the numbers smaller
"""
#: [records] of a table of means.
MEANS = '[records]\nreader = "means"                     # mean lifts in the schedule, no samples\n'
TRIALS = """\
[trials]
file = "trials.csv"                  # one row per trial
"""
CHOICES = """\
# Further columns are optional, each with its unit: start, session, approach, supply, current, rpm, power, temperature,
# pressure, humidity, tilt, orientation, turn, propeller, fountain. Only logged quantities can be tested as causes.

# A plan: `nearlift design` predicts what it could detect, and draws a schedule.
# [design]
# distances = { ground = ["26 mm", "30 mm", "40 mm", "60 mm", "120 mm", "260 mm"] }
# throttles = ["25 percent", "50 percent", "75 percent", "92 percent"]
# visits    = 15
# sessions  = 5
# noise     = { relative = "0.5 percent", force = "0.3 mN", height = "0.05 mm" }

# Standard uncertainties that repeated trials do not show. How well are radius, spacing and distance known?
# [[uncertainty]]
# name  = "rotor radius"
# on    = "rotor_radius"             # height | force | gain | rotor_radius | rotor_spacing | exponent | mass | air_density
# value = "0.5 percent"
# scope = "campaign"                 # shared by: sample | trial | distance | throttle | session | boundary | campaign
# [[uncertainty]]
# name  = "rotor spacing"
# on    = "rotor_spacing"
# value = "0.5 percent"
# scope = "campaign"
# [[uncertainty]]
# name  = "distance datum"
# on    = "height"
# value = "0.2 mm"
# scope = "boundary"
"""
#: Asked for in words: the interval leaves out what the manifest does not state.
ASKED = "campaign.toml: [[uncertainty]] of rotor radius and rotor spacing, if they are known"


def document(name: str, records: str, trials: str) -> str:
    """A whole manifest, with these tables of records and of trials."""
    facts = tomlkit.parse(FACTS)
    facts["name"] = name
    return "\n".join([tomlkit.dumps(facts), records, trials, CHOICES])


def blanks(text: str) -> list[str]:
    """The lines of a manifest that are to be filled in."""
    lines = enumerate(text.splitlines(), 1)
    return [f"line {i}: {line.split('#')[0].strip()}" for i, line in lines if BLANK in line]


def records_tables(
    inspected: Sequence[Inspection], files: str | None = None, cell: bool = True
) -> str:
    """[load_cell], [records] and, for sweeps, [segments] of records that are alike; `cell`: with
    the range and accuracy of the load cell to fill in.
    """
    first = inspected[0]
    doc = tomlkit.parse(CELL)
    _load_cell(doc, inspected, cell)
    records = tomlkit.parse(RECORDS)
    table = records["records"]
    assert isinstance(table, Table)
    _set(table, "reader", first.reader, "")
    sweep = first.ramp is not None
    mark = "{record}" if sweep else "{trial}"
    alone = first.path.name if first.reader == "parquet" else f"{mark}{first.path.suffix}"
    table["files"] = files if files is not None else alone
    _force(table, first)
    named = {"columns": list(first.columns)} if first.columns else {}
    if dialect := {**first.dialect, **named}:
        _set(table, "dialect", _inline(dialect), "the file has no names: FILL IN" if named else "")
    clock = first.clock
    # a clock whose unit is doubtful, or with many rows to each stamp, is left out
    fine = clock is not None and clock is not first.force and rows_per_stamp(clock) == 1
    if clock is not None and fine and not first.doubt:
        seconds = None if clock.unit else meaning.clock_rate(replace(clock, unit="s"))
        remark = f"in s the rate is {seconds:.6g} Hz" if seconds else ""
        _set(table, "time", _inline({"column": clock.name, "unit": clock.unit or BLANK}), remark)
    parts = [tomlkit.dumps(doc), tomlkit.dumps(records)]
    if all(f.ramp is not None for f in inspected):
        parts.append(_segments(first))
    return "\n".join(parts)


def _load_cell(doc: TOMLDocument, inspected: Sequence[Inspection], cell: bool) -> None:
    first, table = inspected[0], doc["load_cell"]
    assert isinstance(table, Table)
    channels = first.contents.channels
    rates = {c.rate_Hz for c in ([first.force] if first.force is not None else channels)}
    rate = rates.pop() if len(rates) == 1 else None
    why = "the channels differ: that of the force" if rates - {None} else "the file does not say"
    if rate and not first.doubt:
        _set(table, "sample_rate", f"{rate:.6g} Hz", "")
    else:
        _set(table, "sample_rate", "FILL IN Hz", first.doubt or why)
    if first.ramp is not None:
        table.remove("settle")
    elif head := usual_head(inspected):
        _set(table, "tare", f"{head.tare_s:g} s", head.words)
        _set(table, "settle", f"{head.settle_s:g} s", head.steady)
    if not cell:
        table.remove("range")
        table.remove("accuracy")


def _force(table: Table, first: Inspection) -> None:
    force = first.force
    if force is None:
        names = ", ".join(c.name for c in first.contents.channels[:8])
        blank = {"column": BLANK, "unit": BLANK, "sign": 1}
        _set(table, "force", _inline(blank), f"one of: {names}")
        return
    unit = AS_FORCE.get(force.unit, force.unit)
    content: dict[str, Any] = {"column": force.name, "unit": unit, "sign": 1}
    remarks = []
    if unit == "count":
        content["calibration"] = {"gain": "FILL IN mN/count", "offset": "FILL IN count"}
    elif unit not in FORCE_UNITS:
        content["unit"] = BLANK
        remarks.append("the file does not say the unit")
    known = force.values[np.isfinite(force.values)]
    if len(known) and -float(known.min()) > 3 * abs(float(known.max())) and not first.wraps:
        remarks.append("sign = -1 if lift makes these numbers negative")
    _set(table, "force", _inline(content), "; ".join(remarks))


def _segments(first: Inspection) -> str:
    """[segments] of a sweep, with the further columns that a schedule knows."""
    assert first.ramp is not None
    doc = tomlkit.parse(first.ramp.segments)
    cut: Any = doc["segments"]
    for name, (channel, unit) in first.further.items():
        cut.setdefault("columns", tomlkit.table())
        if name not in cut["columns"]:
            cut["columns"][name] = _inline({"column": channel.name, "unit": unit})
    return tomlkit.dumps(doc)


def trials_table(schedule: ProposedSchedule) -> str:
    """[trials] of a schedule; what no column says is a constant to fill in."""
    doc = tomlkit.parse(TRIALS)
    table: Any = doc["trials"]
    if not schedule.ordered:
        _set(
            table, "order", BLANK, '"run": the rows are in run order; "unknown": a published table'
        )
    given = tomlkit.table()
    for name, unit in schedule.units.items():
        usual = units.USUAL.get(BY_NAME[name].dimension, (units.SI[BY_NAME[name].dimension],))
        remark = "" if unit else " | ".join(usual)
        _set(given, name, unit or BLANK, "rotor radii" if unit == RADII else remark)
    constants = tomlkit.table()
    constants.comment("the same for every trial")
    for name in schedule.lacking:
        constants[name] = BLANK
    if "lift" in schedule.units and "lift_sd" not in schedule.units:
        unit = schedule.units["lift"] or "N"
        given.add(tomlkit.comment(f'lift_sd = "{unit}"     # standard deviation of a lift: needed'))
        given.add(tomlkit.comment("below 45 rows, as a column or as a constant: lift_sd = 0.1"))
    table["units"] = given
    if schedule.lacking:
        table["constants"] = constants
    return tomlkit.dumps(doc)


def _set(table: Table, key: str, value: Any, comment: str) -> None:
    """Set a key, with a comment behind it; an empty one removes that of the template."""
    table[key] = value
    item: Any = table[key]
    item.trivia.comment = f"# {printable(comment)}" if comment else ""
    item.trivia.comment_ws = "   " if comment else ""


def _inline(content: Mapping[str, Any]) -> InlineTable:
    made = tomlkit.inline_table()
    for key, value in content.items():
        made[key] = _inline(value) if isinstance(value, Mapping) else value
    return made
