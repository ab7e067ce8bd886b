"""Answers of a study: reductions, fits, diagnoses, as a notebook shows them: intervals first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypedDict, TypeVar

from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.results.diagnosis import BoundaryDiagnosis, NotDiagnosed
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import BoundaryResult
from nearlift.study import display

if TYPE_CHECKING:
    import pandas as pd

Entry = TypeVar("Entry")
#: What a table has of each coefficient.
QUOTED = ("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95", "unit", "holds")


class AboutRun(TypedDict):
    """What every answer carries of the run that brought it."""

    campaign: str
    rejected: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """What every answer carries.

    Attributes
    ----------
    campaign : str
        Its name.
    rejected : tuple of (str, str)
        Trials that take no part in fits, each with its reason.
    notes : tuple of str
        What the stages had to say.
    drawing : Drawing or None
        The figure that goes with it, as it was when the answer was given.
    """

    campaign: str
    rejected: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    drawing: Drawing | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """A figure of the report: the picture, its words, and the table of exactly what it draws.

    Attributes
    ----------
    name, title, caption, alt : str
        File name without suffix, heading, caption, and the text that stands for it.
    png, pdf : bytes
    table : mapping of str to array
        Columns of one length.
    """

    name: str
    title: str
    caption: str
    alt: str
    png: bytes = field(repr=False)
    pdf: bytes = field(repr=False)
    table: Mapping[str, object] = field(repr=False, compare=False)

    @property
    def data(self) -> pd.DataFrame:
        """What is drawn, a row each."""
        import pandas as pd

        return pd.DataFrame(dict(self.table))

    def save(self, path: str | Path) -> Path:
        """Write it as ``.png`` or ``.pdf``, by the name's suffix; `UsageError` for another."""
        path = Path(path)
        kinds = {".png": self.png, ".pdf": self.pdf}
        if path.suffix not in kinds:
            raise UsageError(str(path), "is neither .png nor .pdf", "end the name in one of them")
        path.write_bytes(kinds[path.suffix])
        return path

    def _repr_html_(self) -> str:
        return display.drawing(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction(Answered):
    """Trials reduced to cells.

    Attributes
    ----------
    trials : DataFrame
        A trial a row, in run order, rejected ones included: ``trials.parquet``.
    cells : DataFrame
        Change of lift per boundary, distance and throttle: ``lift.parquet``.
    covariance : (n, n) DataFrame
        Of `delta_L`, in the order of `cells` along both axes. Cells share `L_inf`, so it is not
        diagonal. Empty beyond 2000 cells.
    """

    trials: pd.DataFrame = field(repr=False, compare=False)
    cells: pd.DataFrame = field(repr=False, compare=False)
    covariance: pd.DataFrame = field(repr=False, compare=False)

    def _repr_html_(self) -> str:
        return display.reduction(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ByBoundary(Answered, Generic[Entry]):
    """An entry of each boundary, and what is to be quoted there."""

    boundaries: Mapping[Boundary, Entry]
    quoted: Mapping[Boundary, BoundaryResult]

    def __iter__(self) -> Iterator[Entry]:
        """Boundary by boundary: ground, ceiling, sidewall."""
        return iter(self.boundaries.values())

    @property
    def table(self) -> pd.DataFrame:
        """A coefficient to be quoted a row, with verdict and named effects."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "boundary": boundary,
                    "model": result.base_model,
                    "verdict": result.verdict,
                    "effects": " + ".join(result.effects),
                    "coefficient": name,
                }
                | {key: getattr(c, key) for key in QUOTED}
                for boundary, result in self.quoted.items()
                for name, c in result.coefficients.items()
            ]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryFit:
    """Every model of one boundary; the base model is the one that the loop questions."""

    boundary: Boundary
    base: ModelFit
    models: Mapping[str, ModelFit]

    def __getitem__(self, model: str) -> ModelFit:
        """The model of that name; `UsageError` with those that there are."""
        return _entry(self.models, model, f"no fit of {model!r} at the {self.boundary}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit(ByBoundary[BoundaryFit]):
    """Every model at every boundary: ``fit.json``, the draws of ``posterior.parquet``, and what is
    to be quoted: ``results.json``.

    ``fit.quoted["ground"].coefficients["K_b"].lo90`` is the lower end of the 90 % interval to
    publish; until the residuals have been diagnosed it is that of the base fit. A model's own
    `coefficients` are what it would be if that model were right and nothing missing.
    """

    posterior: pd.DataFrame = field(repr=False, compare=False)

    def __getitem__(self, boundary: str) -> BoundaryFit:
        """The fits of that boundary; `UsageError` with those that there are."""
        return _entry(self.boundaries, boundary, f"{boundary!r} was not fitted")

    def draws(self, boundary: str, model: str | None = None) -> pd.DataFrame:
        """Posterior draws, a draw a row and a parameter a column; of the base model unless another
        is named.
        """
        wanted = self[boundary].base.model if model is None else self[boundary][model].model
        rows = self.posterior[
            (self.posterior["boundary"] == boundary) & (self.posterior["model"] == wanted)
        ]
        if rows.empty:
            raise UsageError(
                f"draws of {wanted}",
                f"there are none at the {boundary}",
                "its posterior was not reached: see `notes`",
            )
        return rows.pivot_table(
            index=["chain", "draw"], columns="parameter", values="value", sort=False
        )

    def _repr_html_(self) -> str:
        return display.fit(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis(ByBoundary[BoundaryDiagnosis | NotDiagnosed]):
    """The closed loop at every boundary: ``diagnosis.json``, and what is to be quoted after it:
    ``results.json``.

    ``diagnosis["ground"].verdict`` is one word.
    """

    def __getitem__(self, boundary: str) -> BoundaryDiagnosis | NotDiagnosed:
        """What was found at that boundary; `UsageError` with those that there are."""
        return _entry(self.boundaries, boundary, f"{boundary!r} was not diagnosed")

    def _repr_html_(self) -> str:
        return display.diagnosis(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished(Answered):
    """A run brought to its end: the report, and which stages had to run for it."""

    report: Path
    ran: tuple[str, ...]

    def _repr_html_(self) -> str:
        return display.finished(self)


def _entry(entries: Mapping[Any, Entry], key: str, what: str) -> Entry:
    if key not in entries:
        raise UsageError(key, what, f"there are {', '.join(map(str, entries)) or 'none'}")
    return entries[key]
