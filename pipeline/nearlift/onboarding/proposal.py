"""Tables of a manifest for inspected files; facts that no file states are marked FILL IN."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit import TOMLDocument
from tomlkit.items import InlineTable

from nearlift import units
from nearlift.campaign.manifest import BLANK
from nearlift.onboarding.inspection import UNNAMED, Inspection
from nearlift.onboarding.tables import ProposedSchedule
from nearlift.printing import printable
from nearlift.readers.base import AS_FORCE, FORCE_UNITS, rate_of
from nearlift.schedule import BY_NAME, DIAMETERS, RADII, REQUIRED

HERE = Path(__file__).parent
#: Share of the rest head that is left as margin, and of the records that the margin is for.
MARGIN, OF_RECORDS = 0.1, 0.95
#: Asked for in words: the interval leaves out uncertainties that the manifest does not state.
ASKED = "campaign.toml: [[uncertainty]] of rotor radius and rotor spacing, if they are known"


def template() -> TOMLDocument:
    """Commented manifest with every value to fill in."""
    return tomlkit.parse((HERE / "template.toml").read_text(encoding="utf-8"))


def document(name: str, tables: TOMLDocument) -> str:
    """Whole manifest: the facts of the rig to fill in, these tables, and further choices."""
    whole = template()
    whole["name"] = name
    for key in ("load_cell", "records", "trials"):
        del whole[key]
    whole.update(tables)
    choices = (HERE / "choices.toml").read_text(encoding="utf-8")
    return f"{tomlkit.dumps(whole).rstrip()}\n\n{choices}"


def blanks(text: str) -> list[str]:
    """Lines of a manifest that are to be filled in."""
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if not line.startswith("#")]
    return [f"line {i}: {line.split('#')[0].strip()}" for i, line in lines if BLANK in line]


def for_means() -> TOMLDocument:
    """[records] of a table of means."""
    doc = tomlkit.document()
    doc["records"] = tomlkit.table()
    _set(doc["records"], "reader", "means", "mean lifts in the schedule, no samples")
    return doc


def are_swept(inspected: Sequence[Inspection]) -> bool:
    """Whether each of these records sweeps the throttle, so that it is cut into trials."""
    return all(f.ramp is not None for f in inspected)


def for_records(
    inspected: Sequence[Inspection], files: str | None = None, *, cell: bool = True
) -> TOMLDocument:
    """[load_cell], [records] and, for sweeps, [segments] of records that are alike.

    `cell`: with the accuracy of the load cell to fill in.
    """
    doc, whole, first = tomlkit.document(), template(), inspected[0]
    load_cell: Any = whole["load_cell"]
    doc["load_cell"], doc["records"] = load_cell, whole["records"]
    rates = {c.rate_Hz for c in ([first.force] if first.force else first.contents.channels)}
    if len(rates) == 1 and not first.doubt and (rate := rates.pop()):
        _set(load_cell, "sample_rate", f"{rate:.6g} Hz")
    else:
        differ = "the channels differ: that of the force"
        why = first.doubt or (differ if rates - {None} else "the file does not say")
        _set(load_cell, "sample_rate", "FILL IN Hz", why)
    if not cell:
        del load_cell["accuracy"]
    _fill_records(doc["records"], first, files)
    if first.ramp is None or not are_swept(inspected):
        _state_head(load_cell, inspected)
        return doc
    del load_cell["settle"]
    doc.update(tomlkit.parse(first.ramp.segments))
    cut: Any = doc["segments"]
    for name, (channel, unit) in first.further.items():
        brought = cut.setdefault("columns", tomlkit.table())
        brought.setdefault(name, _inline({"column": channel.name, "unit": unit}))
    return doc


def for_trials(schedule: ProposedSchedule) -> TOMLDocument:
    """[trials] of a schedule; columns that it lacks are constants to fill in."""
    doc = tomlkit.document()
    doc["trials"] = template()["trials"]
    trials: Any = doc["trials"]
    columns = schedule.trials.columns
    if "lift" in columns and "start" not in columns:
        order = '"run": the rows are in run order; "unknown": a published table'
        _set(trials, "order", BLANK, order)
    given = trials["units"] = tomlkit.table()
    for name, unit in schedule.units.items():
        usual = units.usual(BY_NAME[name].dimension)
        remark = {"": " | ".join(usual), RADII: "rotor radii", DIAMETERS: "rotor diameters"}
        _set(given, name, unit or BLANK, remark.get(unit, ""))
    if "lift" in schedule.units and "lift_sd" not in schedule.units:
        unit = schedule.units["lift"] or "N"
        given.add(tomlkit.comment(f'lift_sd = "{unit}"     # standard deviation of a lift: needed'))
        given.add(tomlkit.comment("below 45 rows, as a column or as a constant: lift_sd = 0.1"))
    # pieces of a record bring their throttle
    brought = ["throttle"] * (columns[0] == "record")
    if lacking := [name for name in REQUIRED[1:] if name not in {*columns, *brought}]:
        constants = trials["constants"] = tomlkit.table()
        constants.comment("the same for every trial")
        constants.update(dict.fromkeys(lacking, BLANK))
    return doc


def _state_head(load_cell: Any, inspected: Sequence[Inspection]) -> None:
    """State a tare and settling that leave a margin, if most records show a rest head."""
    starts = [
        np.array(start) / f.force.rate_Hz
        for f in inspected
        if f.force and f.force.rate_Hz
        for start in f.starts
        if start
    ]
    if 2 * len(starts) <= sum(max(len(f.starts), 1) for f in inspected):
        return
    begins, steady = np.sort(starts, axis=0).T.tolist()
    early = float(np.quantile(begins, 1 - OF_RECORDS, method="higher"))
    late = float(np.quantile(steady, OF_RECORDS, method="lower"))
    tare = _two_digits(early * (1 - MARGIN), math.floor)
    settle = _two_digits(late - tare + MARGIN * early, math.ceil)
    span = " to ".join(f"{s:.3g}" for s in dict.fromkeys((begins[0], begins[-1])))
    records = f"{len(starts)} record{'s' * (len(starts) > 1)}"
    _set(load_cell, "tare", f"{tare:g} s", f"rotors at rest: they start at {span} s ({records})")
    words = f"left out after the tare: the lift is steady from {late:.3g} s on"
    _set(load_cell, "settle", f"{settle:g} s", words)


def _two_digits(value: float, rounded: Callable[[float], int]) -> float:
    digits = 1 - math.floor(math.log10(value))
    return float(rounded(value * 10**digits) / 10**digits)


def _fill_records(records: Any, first: Inspection, files: str | None) -> None:
    """Fill in reader, files, force, dialect and clock."""
    _set(records, "reader", first.reader)
    mark = "{trial}" if first.ramp is None else "{record}"
    alone = first.path.name if first.reader == "parquet" else f"{mark}{first.path.suffix}"
    records["files"] = alone if files is None else files
    _set(records, "force", *_force(first))
    if first.dialect:
        unnamed = f"{UNNAMED} 1" in str(first.dialect.get("columns"))
        remark = "the file has no names: FILL IN" if unnamed else ""
        _set(records, "dialect", _inline(first.dialect), remark)
    clock = first.clock
    # a clock whose unit is doubtful, or with many rows to each stamp, is left out
    if clock is None or first.doubt or clock is first.force or first.rows_per_stamp > 1:
        return
    in_s = None if clock.unit or len(clock.values) < 3 else rate_of(clock.values)
    remark = f"in s the rate is {in_s:.6g} Hz" if in_s else ""
    _set(records, "time", _inline({"column": clock.name, "unit": clock.unit or BLANK}), remark)


def _force(first: Inspection) -> tuple[InlineTable, str]:
    """[records] force, and the remark on it."""
    force = first.force
    if force is None:
        names = ", ".join(c.name for c in first.contents.channels[:8])
        return _inline({"column": BLANK, "unit": BLANK, "sign": 1}), f"one of: {names}"
    unit, remarks = AS_FORCE.get(force.unit, force.unit), []
    content: dict[str, object] = {"column": force.name, "unit": unit, "sign": first.sign or 1}
    if unit == "count":
        content["calibration"] = {"gain": "FILL IN mN/count", "offset": "FILL IN count"}
    elif unit not in FORCE_UNITS:
        content["unit"] = BLANK
        remarks.append(f"the file says {unit}" if unit else "the file does not say the unit")
    if first.sign < 0:
        remarks.append("lift makes these numbers smaller")
    elif not first.sign and not first.wraps and (force.values < 0).sum() > len(force.values) / 2:
        remarks.append("sign = -1 if lift makes these numbers negative")
    return _inline(content), "; ".join(remarks)


def _set(table: Any, key: str, value: object, comment: str = "") -> None:
    """Set a key, with a comment behind it; an empty one removes that of the template."""
    table[key] = value
    trivia = table[key].trivia
    trivia.comment = f"# {printable(comment)}" if comment else ""
    trivia.comment_ws = "   " if comment else ""


def _inline(content: Mapping[str, object]) -> InlineTable:
    made = tomlkit.inline_table()
    made.update({k: _inline(v) if isinstance(v, Mapping) else v for k, v in content.items()})
    return made
