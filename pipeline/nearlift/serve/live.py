"""A campaign while it is being recorded: each trial as its record lands, and what the last look at
all of them found.

A record is reduced alone, by the code of stage ingest, and so is there at once; what needs every
trial (levels, fits, verdicts) comes from the products of `nearlift run --watch`, and so do
the trials of records that are known only together: one table for all, or records that are cut.
"""

from __future__ import annotations

import csv
import json
import math
import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from nearlift import catalogue, readers
from nearlift.errors import NearliftError
from nearlift.manifest import campaign as manifests
from nearlift.manifest.campaign import Campaign
from nearlift.products import DIAGNOSIS, FIT, RESULTS, TRIALS
from nearlift.readers.files import per_trial
from nearlift.readers.schedule import Schedule, read_schedule, schedule_file
from nearlift.readers.seam import MARK
from nearlift.reduction import plausibility, quality
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis
from nearlift.results.quotation import Results
from nearlift.run import store
from nearlift.run.intact import WRITING_NS
from nearlift.serve.bench import ServedCampaign, ServedWorkspace, Work
from nearlift.stages import judge
from nearlift.stages.rows import Rows, Task, reduce_piece

#: Seconds between looks at the folder, or this many times what the last one took; records that are
#: reduced in one look, where the next follows at once.
PERIOD_S, TIMES, PER_LOOK = 0.25, 3.0, 512
#: Characters of a look's line that is parsed.
LONGEST = 1 << 16
#: Columns of trials that a page shows.
SHOWN = ("trial", "boundary", "z_hat", "throttle", "lift_N", "u_lift_N", "quality", "fault")


class Live:
    """The trials of one campaign as they land; every change of one has a number, its turn."""

    def __init__(self, place: ServedCampaign) -> None:
        self.place = place
        self.refusal = ""
        self.turn = self.epoch = 0
        self._lock = threading.Lock()
        self._next = 0.0
        self._behind = False
        self._stamps: tuple[object, ...] = ()
        self._seen: dict[str, tuple[int, int]] = {}
        self._campaign: Campaign | None = None
        self._schedule: Schedule | None = None
        self._rows = Rows(0)
        self._table: store.Table = {}
        self._turns: list[int] = []
        self._far: dict[str, dict[str, float]] = {}

    def look(self) -> None:
        """Take up what has landed since the last look, unless that was a moment ago."""
        with self._lock:
            begun = time.monotonic()
            if begun < self._next:
                return
            self._behind = False
            try:
                self._take_up()
                self.refusal = ""
            except (NearliftError, OSError) as refusal:
                self.refusal = str(refusal)
            wait = max(PERIOD_S, TIMES * (time.monotonic() - begun))
            self._next = begun + (0.0 if self._behind else wait)

    def since(self, epoch: int, turn: int) -> tuple[dict[str, object], int, int]:
        """What changed after a turn; all of it where the campaign was begun anew."""
        with self._lock:
            turn = turn if epoch == self.epoch else 0
            changed = [i for i, last in enumerate(self._turns) if last > turn]
            changes = {
                "fresh": epoch != self.epoch,
                "scheduled": len(self._turns),
                "far": self._far,
                "refusal": self.refusal,
                "trials": [self._trial(i) for i in changed],
            }
            return changes, self.epoch, self.turn

    def _trial(self, i: int) -> dict[str, object]:
        """One trial."""
        trial = {name: self._table[name][i] for name in SHOWN}
        codes = trial["quality"].split()
        return {
            "i": i,
            "trial": str(trial["trial"]),
            "boundary": str(trial["boundary"]),
            "z": _finite(trial["z_hat"]),
            "throttle": _finite(trial["throttle"]),
            "lift": _finite(trial["lift_N"]),
            "u": _finite(trial["u_lift_N"]),
            "codes": codes,
            "said": _meaning(trial["quality"]),
            "fault": str(trial["fault"]),
        }

    def _take_up(self) -> None:
        """Read what is new."""
        root = self.place.root
        stamps = [_stamp((root / "campaign.toml").stat())]
        if self._campaign is not None:
            stamps.append(_stamp(schedule_file(self._campaign, root).stat()))
        if tuple(stamps) != self._stamps:
            self._begin()
        campaign, schedule = self._campaign, self._schedule
        assert campaign is not None
        assert schedule is not None
        reader = readers.reader(campaign.records.reader)
        if campaign.cuts_records or not reader.series or MARK not in campaign.records.pattern:
            self._from_product()
            return
        files = per_trial(campaign, root, schedule.trial.tolist())
        if self._seen.keys() - files.keys():
            # a record was taken away
            self._begin()
        stamped = ((trial, _stamp(path.stat())) for trial, (path, _) in files.items())
        new = [(trial, stamp) for trial, stamp in stamped if self._seen.get(trial) != stamp]
        self._behind = len(new) > PER_LOOK
        if not new:
            return
        self._read(campaign, schedule, dict(new[:PER_LOOK]))

    def _begin(self) -> None:
        """Another manifest or schedule: everything anew."""
        root = self.place.root
        self._campaign = campaign = manifests.load(root)
        self._schedule = schedule = read_schedule(campaign, root)
        files = (root / "campaign.toml", schedule_file(campaign, root))
        self._stamps = tuple(_stamp(path.stat()) for path in files)
        self._rows, self._seen, self._far = Rows(len(schedule)), {}, {}
        self._table, self._turns = {}, [0] * len(schedule)
        self.epoch, self.turn = self.epoch + 1, 0

    def _from_product(self) -> None:
        """The trials of the last look."""
        file = self.place.homes.processed / TRIALS.file
        if not file.is_file() or self._seen.get(TRIALS.file) == (stamp := _stamp(file.stat())):
            return
        table = store.read_table(file, TRIALS)
        self._seen[TRIALS.file] = stamp
        self.epoch, self.turn, self._turns, self._table = self.epoch + 1, 0, [], {}
        self._show(table, set())

    def _read(
        self, campaign: Campaign, schedule: Schedule, stamps: dict[str, tuple[int, int]]
    ) -> None:
        """Reduce these records and judge all there are."""
        root, reader = self.place.root, readers.reader(campaign.records.reader)
        place = {str(trial): i for i, trial in enumerate(schedule.trial)}
        after = schedule.covariates.get("tare_after_N")
        fresh: set[int] = set()
        for piece in reader.plan(campaign, root, list(stamps)).pieces:
            tares = {} if after is None else {t: float(after[place[t]]) for t in piece.trials}
            task = Task(root=root, campaign=campaign, piece=piece, tare_after_N=tares, inputs={})
            for row in reduce_piece(task):
                i = place[row.trial]
                self._rows.put(i, row)
                young = time.time_ns() - stamps[row.trial][1] < WRITING_NS
                if young and not {"truncated", "MALFORMED"}.isdisjoint(row.reduced.codes):
                    self._rows.codes[i] = (*row.reduced.codes, "PENDING")
                fresh.add(i)
        self._seen |= stamps
        self._show(judge.table_of(schedule, self._rows, campaign), fresh)

    def _show(self, table: store.Table, fresh: set[int]) -> None:
        """Take these columns for those before, and give what is `fresh`, or judged otherwise than
        before, its turn.
        """
        self._far = {
            side: {f"{t:.6g}": lift for t, lift in zip(*levels, strict=True)}
            for side, levels in plausibility.far_lifts(table).items()
        }
        codes = table["quality"].tolist()
        before = self._table["quality"].tolist() if self._table else [None] * len(codes)
        missing = ["MISSING" if code is None else code for code in before]
        self.turn += 1
        self._turns = self._turns or [0] * len(codes)
        for i, (old, new) in enumerate(zip(missing, codes, strict=True)):
            if i in fresh or old != new:
                self._turns[i] = self.turn
        self._table = {name: table[name] for name in SHOWN}


def _stamp(status: os.stat_result) -> tuple[int, int]:
    return status.st_size, status.st_mtime_ns


def _finite(value: float) -> float | None:
    return float(f"{value:.7g}") if math.isfinite(value) else None


def watching(workspace: ServedWorkspace, place: ServedCampaign) -> Work | None:
    """The command that watches a campaign, where one is at it."""
    return next(
        (
            work
            for work in workspace.works.values()
            if work.ended is None and work.campaign == place.given and "--watch" in work.words
        ),
        None,
    )


def looks(lines: list[str]) -> Iterator[dict[str, object]]:
    """The looks among what `nearlift run --watch --json` says."""
    for line in lines:
        if line.startswith("{") and len(line) < LONGEST:
            look = json.loads(line)
            if "words" in look:
                yield {key: look[key] for key in ("words", "refused", "good", "scheduled")}


def looked(place: ServedCampaign) -> dict[str, object]:
    """What the last look found: verdicts, curves, residuals, single trials that count for much."""
    home, reports = place.homes.processed, place.homes.reports
    quoted = store.load_if_whole(home / RESULTS.file, Results(boundaries={})).boundaries
    diagnosed = store.load_if_whole(home / DIAGNOSIS.file, NOTHING).boundaries
    fitted = store.read_json_if_whole(home / FIT.file)
    influence: Any = fitted.get("influence", {})
    verdicts = []
    for boundary, quotation in quoted.items():
        diagnosis = diagnosed.get(boundary)
        look = diagnosis.look if isinstance(diagnosis, BoundaryDiagnosis) else None
        verdicts.append(
            {
                "boundary": boundary,
                "headline": quotation.headline_text,
                "claim": catalogue.titled(quotation.claim),
                "paid": look.text if look else "",
                "leaning": quotation.leaning,
                "rivals": list(quotation.rivals),
                "coefficients": list(quotation.coefficients),
            }
        )
    codes = {}
    if (home / TRIALS.file).is_file():
        table = store.read_table(home / TRIALS.file, TRIALS)
        codes = {str(t): q for t, q in zip(table["trial"], table["quality"], strict=True) if q}
    return {
        "verdicts": verdicts,
        "suspects": [
            f"{boundary}: {suspect['text']}"
            for boundary, sizes in influence.items()
            for suspect in sizes["suspects"]
        ],
        "codes": {t: {"codes": q.split(), "said": _meaning(q)} for t, q in codes.items()},
        "curves": _curves(reports / "fig2.csv"),
        "residuals": _residuals(reports / "residuals.csv"),
    }


def _meaning(codes: str) -> str:
    return "; ".join(quality.code(name).meaning for name in codes.split())


def _table(path: os.PathLike[str]) -> Iterator[dict[str, str]]:
    try:
        with open(path, newline="", encoding="utf-8") as file:  # noqa: PTH123 - any path
            yield from csv.DictReader(file)
    except FileNotFoundError:
        return


def _curves(path: os.PathLike[str]) -> dict[str, list[list[float]]]:
    """Of each boundary the fitted curve of Figure 2: z over R, Delta L in percent, its ends."""
    names = ("z_hat", "delta_L_percent", "lo90_percent", "hi90_percent")
    curves: dict[str, list[list[float]]] = {}
    for row in _table(path):
        if row["kind"] == "band":
            curves.setdefault(row["panel"], []).append([float(row[n] or "nan") for n in names])
    return {k: [p for p in line if np.isfinite(p).all()] for k, line in curves.items()}


def _residuals(path: os.PathLike[str]) -> dict[str, dict[str, list[list[object]]]]:
    """By boundary and covariate: covariate, residual in percent, trial."""
    panels: dict[str, dict[str, list[list[object]]]] = {}
    for row in _table(path):
        if row["kind"] == "trial" and row["x"] and row["residual_percent"]:
            x, y = float(row["x"]), float(row["residual_percent"])
            if math.isfinite(x) and math.isfinite(y):
                panel = panels.setdefault(row["panel"], {})
                panel.setdefault(row["covariate"], []).append([x, y, row["trial"]])
    return panels
