"""[segments] of the manifest: how one record is cut into many trials."""

from __future__ import annotations

import math
from typing import Self

from pydantic import model_validator

from nearlift import units
from nearlift.campaign.quantities import Duration, PositiveDuration, Section
from nearlift.campaign.rig import RECORD_MARK, LoadCell, Records
from nearlift.errors import ManifestError

#: Ways to cut that are no column's name.
WAYS = ("plateaus", "markers", "windows")
#: Samples of a trial, at least: aborted runs leave two to four rows behind.
FEWEST_SAMPLES = 5
#: What stands for a number in the line that begins a piece.
LEVEL = "{level}"


class ColumnOfRecord(Section):
    """A column of the records and what its numbers mean: `unit`, or, of a command in steps of its
    own, what it reads at rest (`zero`) and at full throttle (`full`).
    """

    column: str
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None

    def linear(self, dimension: str, key: str) -> tuple[float, float]:
        """SI is factor * number + offset; `dimension` is empty for a number that has none.

        Raises
        ------
        ManifestError
            There is no unit where one is needed, or it is of another dimension.
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
            hint = (
                ', or full = ..., "the number at full throttle"' if dimension == "throttle" else ""
            )
            raise ManifestError(
                f"{key}.unit",
                "is missing",
                f"say the unit of {self.column!r}{hint}",
            )
        return units.to_si(self.unit, dimension, f"{key}.unit")


class Segments(Section):
    """How a record is cut into pieces, each of which becomes a trial.

    Attributes
    ----------
    by : str
        The column whose steps part the pieces; or "plateaus" (levels of the force, or of the
        column `of`, found by their change), "markers" (lines of text), "windows" (of `length`).
    settle, shortest : float
        Dropped after each cut, s; and what must then be left, s: a shorter piece is no trial.
    unit, zero, full
        Of the column's numbers, as in `ColumnOfRecord`.
    maps : str
        What the level is in the schedule: "throttle", "distance", "reached" or a covariate.
    hold : float
        Two samples are one level within this, in the column's own numbers.
    only : str or number or None
        Pieces in which the column holds this alone are kept, such as "on".
    of, step : str or None
        Of plateaus: the column, and the smallest change that is a step, a force or a number of the
        column's own.
    begin, end : str or None
        Of markers: whole lines between which a piece lies; ``{level}`` stands for a number.
    length : float or None
        Of windows; where pieces are cut otherwise, they are cut on into windows, s.
    covariates : list of str or None
        Columns whose mean and scatter are kept; None for every column of numbers.
    columns : dict
        Columns of the records that are the schedule's own, such as `supply`.
    """

    by: str
    settle: Duration
    shortest: PositiveDuration
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None
    maps: str = "throttle"
    hold: float = 0.0
    only: str | float | int | None = None
    of: str | None = None
    step: str | float | None = None
    begin: str | None = None
    end: str | None = None
    length: PositiveDuration | None = None
    covariates: list[str] | None = None
    columns: dict[str, ColumnOfRecord] = {}

    @property
    def column(self) -> str | None:
        """The column whose steps part the pieces; None where something else does."""
        return None if self.by in WAYS else self.by

    @property
    def has_level(self) -> bool:
        """Whether a piece's level says what the schedule then need not: that of a stepping column,
        or a number in the line that begins it.
        """
        if self.only is not None:
            return False
        return self.column is not None or LEVEL in (self.begin or "")

    def level(self) -> ColumnOfRecord:
        """The level's column and what its numbers mean."""
        return ColumnOfRecord(column=self.by, unit=self.unit, zero=self.zero, full=self.full)

    def step_N(self) -> float:
        """The smallest step of the force, N."""
        return units.quantity(self.step, "force", "segments.step")

    @model_validator(mode="after")
    def _keys_of_its_own_way(self) -> Self:
        needs = {"plateaus": "step", "markers": "begin", "windows": "length"}
        ways = {"of": "plateaus", "step": "plateaus", "begin": "markers", "end": "markers"}
        for key, way in ways.items():
            if getattr(self, key) is not None and self.by != way:
                raise ValueError(f'{key} goes with by = "{way}"')
        if self.by in WAYS and getattr(self, needs[self.by]) is None:
            raise ValueError(f'by = "{self.by}" needs {needs[self.by]}')
        if self.column is None and (self.hold or self.only is not None):
            raise ValueError("hold and only go with by = a column of the record")
        if not self.hold >= 0 or not math.isfinite(self.hold):
            raise ValueError("hold is a size, in the column's own numbers")
        if self.length is not None and self.length < self.shortest:
            raise ValueError("length is below shortest: no window would be a trial")
        if self.by == "windows" and self.settle >= (self.length or 0.0):
            raise ValueError("settle takes a whole window: make length the longer")
        if self.step is not None and self.of is None:
            try:
                self.step_N()
            except ManifestError as refusal:
                raise ValueError(f"step: {refusal.what}\n{refusal.remedy}") from None
        if self.of is not None and not isinstance(self.step, int | float):
            raise ValueError(f"step is a number, as the column {self.of!r} has them")
        return self


def fit_the_rest(cut: Segments | None, records: Records, cell: LoadCell, rate_Hz: float) -> None:
    """See that what is said of records and load cell goes with their being cut into trials, or not.

    Raises
    ------
    ValueError
        It does not.
    """
    if cut is None:
        if cell.tare == "level 0" or RECORD_MARK in (records.files or ""):
            what = (
                'load_cell.tare = "level 0"'
                if cell.tare == "level 0"
                else f"{RECORD_MARK} in files"
            )
            raise ValueError(f"{what} goes with [segments]; without it a record is a trial")
        return
    if RECORD_MARK not in (records.files or ""):
        raise ValueError(
            f"with [segments] a file is a record: write {RECORD_MARK} in [records] files, as in"
            f' "sweeps/{RECORD_MARK}.csv"'
        )
    if cell.settle or cell.record is not None:
        raise ValueError(
            "[load_cell] settle and record are of records that are one trial each; [segments] has"
            " settle and shortest for its pieces"
        )
    if cell.tare == "level 0" and cut.column is None:
        raise ValueError('tare = "level 0" is the lowest level of a column: [segments] by names it')
    if round(cut.shortest * rate_Hz) < FEWEST_SAMPLES:
        raise ValueError(
            f"[segments] shortest = {cut.shortest:g} s is {cut.shortest * rate_Hz:.3g} samples at"
            f" {rate_Hz:g} Hz; a trial needs {FEWEST_SAMPLES}: {FEWEST_SAMPLES / rate_Hz:.3g} s"
        )
