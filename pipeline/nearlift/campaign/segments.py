"""[segments] of the manifest: cutting of one record into many trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from nearlift import units
from nearlift.campaign.quantities import Duration, PositiveDuration, Section, as_fault
from nearlift.campaign.rig import RECORD_MARK, LoadCell, Records
from nearlift.errors import ManifestError

#: Fewest samples of a trial: aborted runs leave two to four rows.
FEWEST_SAMPLES = 5


class ColumnOfRecord(Section):
    """A column of the records in `unit`, or a command with readings `zero` at rest and `full` at
    full throttle.
    """

    column: str
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None

    def linear(self, dimension: str, key: str) -> tuple[float, float]:
        """Factor and offset to SI; `ManifestError` if the unit is missing or of another dimension.
        An empty `dimension` needs no unit.
        """
        if self.full is not None:
            if dimension != "throttle" or self.full == self.zero:
                raise ManifestError(
                    f"{key}.full",
                    "is no command's full throttle",
                    "full (and zero) go with a throttle, and differ",
                )
            return 1 / (self.full - self.zero), -self.zero / (self.full - self.zero)
        if not dimension:
            return 1.0, 0.0
        if self.unit is None:
            command = dimension == "throttle"
            hint = ', or full = ..., "the number at full throttle"' if command else ""
            what = f"give the unit of {self.column!r}{hint}"
            raise ManifestError(f"{key}.unit", "is missing", what)
        return units.to_si(self.unit, dimension, f"{key}.unit")


class Segments(Section):
    """Cutting of a record into pieces, each of which becomes a trial.

    Either the steps of `column` divide the pieces, or `cut` is "plateaus" or "windows". Plateaus
    are levels of the force, separated by changes of at least `step`. Windows have the length
    `length`, which divides each piece further with the other ways.

    `settle` is dropped after each cut; a piece with less than `shortest` left is no trial. `unit`,
    `zero` and `full` belong to `column`, which `becomes` a column of the schedule. Samples within
    `tolerance` are one level; only pieces at the level `keep_where` are kept. `columns` are those
    of the schedule's columns that the records hold, such as `supply`. Times are in s.
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "by": 'column = "...", or cut = "plateaus" or "windows"',
        "maps": "becomes",
        "only": "keep_where",
        "hold": "tolerance",
    }

    column: str | None = None
    cut: Literal["plateaus", "windows"] | None = None
    settle: Duration
    shortest: PositiveDuration
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None
    becomes: str = "throttle"
    tolerance: float = 0.0
    keep_where: str | float | int | None = None
    step: str | None = None
    length: PositiveDuration | None = None
    columns: dict[str, ColumnOfRecord] = {}

    @property
    def has_level(self) -> bool:
        """Whether a piece's level is in the schedule."""
        return self.keep_where is None and self.column is not None

    def level(self) -> ColumnOfRecord:
        """The level's column with its unit."""
        assert self.column is not None
        return ColumnOfRecord(column=self.column, unit=self.unit, zero=self.zero, full=self.full)

    def step_N(self) -> float:
        """The smallest step of the force, N."""
        return units.quantity(self.step, "force", "segments.step")

    @model_validator(mode="after")
    def _keys_of_its_own_way(self) -> Self:
        needs = {"plateaus": "step", "windows": "length"}
        if (self.column is None) == (self.cut is None):
            raise ValueError('give either column or cut = "plateaus" or "windows"')
        if self.step is not None and self.cut != "plateaus":
            raise ValueError('step needs cut = "plateaus"')
        if self.cut is not None and getattr(self, needs[self.cut]) is None:
            raise ValueError(f'cut = "{self.cut}" needs {needs[self.cut]}')
        if self.column is None and (self.tolerance or self.keep_where is not None):
            raise ValueError("tolerance and keep_where need column, a column of the record")
        if not self.tolerance >= 0 or not math.isfinite(self.tolerance):
            raise ValueError("tolerance is a size, in the numbers of the column")
        if self.length is not None and self.length < self.shortest:
            raise ValueError("length is below shortest: no window would be a trial")
        if self.cut == "windows" and self.settle >= (self.length or 0.0):
            raise ValueError("settle takes a whole window: make length the longer")
        if self.step is not None:
            with as_fault("step: "):
                self.step_N()
        return self


def fit_the_rest(cut: Segments | None, records: Records, cell: LoadCell, rate_Hz: float) -> None:
    """Raise ValueError if records or load cell do not agree with [segments], or its absence."""
    marked, level_0 = RECORD_MARK in (records.files or ""), cell.tare == "level 0"
    if cut is None:
        if marked or level_0:
            what = 'load_cell.tare = "level 0"' if level_0 else f"{RECORD_MARK} in files"
            raise ValueError(f"{what} goes with [segments]; without it a record is a trial")
        return
    if not marked:
        raise ValueError(
            f"with [segments] a file is a record: write {RECORD_MARK} in [records] files, as in"
            f' "sweeps/{RECORD_MARK}.csv"'
        )
    if cell.settle or cell.record is not None:
        raise ValueError(
            "[load_cell] settle and record are of records that are one trial each; [segments] has"
            " settle and shortest for its pieces"
        )
    if level_0 and cut.column is None:
        raise ValueError(
            'tare = "level 0" is the lowest level of a column: name it by [segments] column'
        )
    if round(cut.shortest * rate_Hz) < FEWEST_SAMPLES:
        raise ValueError(
            f"[segments] shortest = {cut.shortest:g} s is {cut.shortest * rate_Hz:.3g} samples at"
            f" {rate_Hz:g} Hz; a trial needs {FEWEST_SAMPLES}: {FEWEST_SAMPLES / rate_Hz:.3g} s"
        )
