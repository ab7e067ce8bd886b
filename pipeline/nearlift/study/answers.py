"""Answers of a study: reductions, fits, diagnoses. A notebook shows each as a table, intervals
first, and under it a small figure: HTML as text, nothing loaded.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypedDict, TypeVar

from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.nomenclature import letter
from nearlift.results.diagnosis import BoundaryDiagnosis, NotDiagnosed
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import BoundaryResult
from nearlift.rounding import plain, plus_minus

if TYPE_CHECKING:
    import pandas as pd

Entry = TypeVar("Entry")
#: What a table has of each coefficient.
QUOTED = ("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95", "unit", "holds")
#: Trials listed by name; more are counted.
LISTED = 5


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

    def _page(self, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
        """A table, remarks, and the figure."""
        cells = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
        )
        names = "".join(f"<th>{escape(name)}</th>" for name in head)
        table = (
            f"<table><caption>{escape(self.campaign)}</caption>"
            f"<thead><tr>{names}</tr></thead><tbody>{cells}</tbody></table>"
        )
        return table + self._remarks() + (self.drawing._repr_html_() if self.drawing else "")

    def _remarks(self) -> str:
        """Rejected trials and notes."""
        lines = [f"{trial}: {reason}" for trial, reason in self.rejected[:LISTED]]
        if len(self.rejected) > LISTED:
            lines.append(f"and {len(self.rejected) - LISTED} more trials rejected")
        lines += self.notes
        if not lines:
            return ""
        items = "".join(f"<li>{escape(line)}</li>" for line in lines)
        return f"<details><summary>{len(lines)} remarks</summary><ul>{items}</ul></details>"


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
        data = base64.b64encode(self.png).decode()
        picture = (
            f'<img src="data:image/png;base64,{data}" alt="{escape(self.alt)}"'
            ' style="max-width:44em;width:100%;background:white">'
        )
        return (
            '<figure style="margin:0.5em'
            f' 0">{picture}<figcaption>{escape(self.caption)}</figcaption></figure>'
        )


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
        rows = []
        for boundary, cells in self.cells.groupby("boundary", sort=False):
            change, u, z_hat = (
                cells[name].to_numpy() for name in ("delta_L", "u_delta_L", "z_hat")
            )
            top = abs(change).argmax()
            largest = f"{plus_minus(100 * change[top], 100 * u[top])} % at {plain(z_hat[top], 3)}"
            ends = f"{plain(z_hat.min(), 3)} to {plain(z_hat.max(), 3)}"
            trials = str(cells["n_trials"].sum())
            rows.append((str(boundary), trials, str(len(cells)), ends, largest))
        return self._page(("boundary", "trials", "cells", "z/r", "largest ΔL"), rows)


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
    base_model: str
    models: Mapping[str, ModelFit]

    @property
    def base(self) -> ModelFit:
        """Fit of the base model."""
        return self.models[self.base_model]

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
        fits = self[boundary]
        wanted = fits.base_model if model is None else model
        fits[wanted]  # refuses a model that was not fitted
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
        head = ("boundary", "base model", "", "value (k = 1)", "90 % interval", "", "χ²/dof")
        rows = []
        for boundary, result in self.quoted.items():
            base = self[boundary].base
            for name, c in result.coefficients.items():
                fits = plain(base.chi2 / base.dof, 3)
                rows.append(
                    (boundary, base.title, letter(name), c.estimate, c.interval, c.holds, fits)
                )
        return self._page(head, rows)


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
        """Verdicts, named effects with rivals, coefficients to be quoted, error on what was held
        out.
        """
        quantity = ("", "value (k = 1)", "90 % interval", "")
        head = ("boundary", "verdict", "effects", *quantity, "held-out error, % of lift")
        rows = []
        for boundary, at in self.boundaries.items():
            others = (
                {e.name: at.stand_ins(e) for e in at.effects}
                if isinstance(at, BoundaryDiagnosis)
                else {}
            )
            named = "; ".join(
                name + (f" (or {', '.join(names)})" if names else "")
                for name, names in others.items()
            )
            error = (
                f"{plain(100 * at.held_out_before, 2)} → {plain(100 * at.held_out_after, 2)} (floor"
                f" {plain(100 * at.noise_floor, 2)})"
            )
            verdict = f"{at.verdict}; {at.sensitivity}" if at.sensitivity else at.verdict
            if at.reason:
                verdict, error = f"not diagnosed: {at.reason}", ""
            about = (boundary, verdict, named or "none")
            for name, c in self.quoted[boundary].coefficients.items():
                rows.append((*about, letter(name), c.estimate, c.interval, c.holds, error))
        return self._page(head, rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished(Answered):
    """A run brought to its end: the report, and which stages had to run for it."""

    report: Path
    ran: tuple[str, ...]

    def _repr_html_(self) -> str:
        where = self.report.resolve()
        ran = ", ".join(self.ran) or "nothing: all was up to date"
        return (
            f'<p>Report: <a href="{escape(where.as_uri())}">{escape(str(where))}</a>. Ran:'
            f" {escape(ran)}.</p>" + self._remarks()
        )


def _entry(entries: Mapping[Any, Entry], key: str, what: str) -> Entry:
    if key not in entries:
        raise UsageError(key, what, f"there are {', '.join(map(str, entries)) or 'none'}")
    return entries[key]
