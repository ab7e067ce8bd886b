"""Evidence of one campaign in memory: its products, as summaries and pages read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign, boundaries_of
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.errors import ProductError
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis, DiagnosisResults, NotDiagnosed
from nearlift.results.document import typed
from nearlift.results.fit import FitResults, ModelFit
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run.tables import Product
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.simulate import SAFETY

if TYPE_CHECKING:
    from nearlift.flight.fitted import SafetyResult

#: Column name -> values, all of one length; text columns are object arrays of str.
Columns = dict[str, NDArray[Any]]
#: A part of a table: a value, or one for each row, by column.
Part = dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """The products that exist, and what is needed to read them; hashed by identity, so that what is
    made of it can be cached.

    Attributes
    ----------
    campaign : Campaign
    tables : mapping of str to Columns
        Table products by file name.
    documents : mapping of str to dict
        JSON products by file name.
    observations : mapping of Boundary to Observations
        The accepted trials of each boundary.
    digests : mapping of str to str
        SHA-256 of each product, by file name.
    inputs : mapping of str to str
        SHA-256 of each raw input, by path within the campaign.
    versions : mapping of str to str
        Of Python and the packages that can change a number.
    folder : str
        Name of the campaign's folder.
    seed : int
    """

    campaign: Campaign
    tables: Mapping[str, Columns] = field(default_factory=dict)
    documents: Mapping[str, dict[str, object]] = field(default_factory=dict)
    observations: Mapping[Boundary, Observations] = field(default_factory=dict)
    digests: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    folder: str = ""
    seed: int = 0

    def has(self, *products: Product) -> bool:
        """Whether all these products exist; a table without rows is none."""
        return all(
            p.file in self.documents or any(map(len, self.tables.get(p.file, {}).values()))
            for p in products
        )

    def table(self, product: Product) -> Columns:
        """A table product; `ProductError` if it does not exist."""
        if product.file not in self.tables:
            raise _missing(product)
        return self.tables[product.file]

    def frame(self, product: Product, **values: object) -> pd.DataFrame:
        """Rows of a table product in which these columns have these values."""
        table = self.table(product)
        keep = np.ones(len(next(iter(table.values()), ())), dtype=bool)
        for name, value in values.items():
            keep &= table[name] == value
        # texts of the posterior's many other rows would take long to convert
        return pd.DataFrame({name: column[keep] for name, column in table.items()})

    def document(self, product: Product) -> dict[str, Any]:
        """A JSON product; `ProductError` if it does not exist."""
        if product.file not in self.documents:
            raise _missing(product)
        return self.documents[product.file]

    @property
    def boundaries(self) -> list[Boundary]:
        """The boundaries that were fitted, in the order ground, ceiling, sidewall."""
        return boundaries_of(self.document(FIT)["boundaries"])

    @cached_property
    def fits(self) -> FitResults:
        """fit.json."""
        return typed(FitResults, self.document(FIT), FIT.file)

    @cached_property
    def results(self) -> Results:
        """results.json."""
        return typed(Results, self.document(RESULTS), RESULTS.file)

    @cached_property
    def diagnosis(self) -> Mapping[Boundary, BoundaryDiagnosis | NotDiagnosed]:
        """Findings of diagnosis.json by boundary; empty without one."""
        if not self.has(DIAGNOSIS):
            return {}
        return typed(DiagnosisResults, self.document(DIAGNOSIS), DIAGNOSIS.file).boundaries

    @cached_property
    def safety(self) -> SafetyResult:
        """safety.json."""
        from nearlift.flight.fitted import SafetyResult

        return typed(SafetyResult, self.document(SAFETY), SAFETY.file)

    def base(self, boundary: Boundary) -> tuple[LiftModel, ModelFit]:
        """The base model of a boundary and its fit."""
        fit = self.fits.of_base(boundary)
        return catalogue.model(self.fits.base[boundary]), fit

    def quoted(self, boundary: Boundary) -> BoundaryResult:
        """Result to quote of a boundary."""
        return self.results.boundaries[boundary]

    def diagnosed(self, boundary: Boundary) -> BoundaryDiagnosis | None:
        """The loop's findings at a boundary; None where there are none, as where it could not be
        diagnosed.
        """
        diagnosis = self.diagnosis.get(boundary)
        return diagnosis if isinstance(diagnosis, BoundaryDiagnosis) else None

    @property
    def left_out(self) -> str:
        """Unit of cross-validation: visits, or trials where the order of run is unknown."""
        return "visits" if self.campaign.trials.order == "run" else "trials"

    def not_diagnosed(self, boundary: Boundary) -> str:
        """Why a boundary could not be diagnosed; empty where it was, or where it was not tried."""
        return str(getattr(self.diagnosis.get(boundary), "reason", ""))

    def known(self, boundary: Boundary, model: LiftModel) -> dict[str, Any]:
        """Inputs of `model` besides its parameters, one value for a whole curve: geometry, else
        the covariate's median.
        """
        geometry = self.campaign.geometry()
        data = self.observations[boundary]
        measured = {"throttle": data.throttle, **data.covariates}
        return {
            n: geometry[n] if n in geometry else float(np.nanmedian(measured[n]))
            for n in model.needs
        }


def _missing(product: Product) -> ProductError:
    remedy = "run the stage that writes it (`nearlift run --dry-run CAMPAIGN` says which)"
    return ProductError(product.file, "is missing", remedy)


def lift_inf_N(fit: ModelFit, data: Observations, drawn: bool = False) -> FloatArray:
    """L_inf in N of each trial; nan at a throttle of which the fit took no trial. It is the median
    of the posterior where it was `drawn` and there is one.
    """
    if data.curve is not None and fit.levels is not None:
        return data.lift_inf_N(np.array(fit.levels.coefficients))
    known = {throttle: e.value for throttle, e in fit.L_inf_N.items()}
    if drawn and fit.posterior and fit.posterior.L_inf_N:
        known = {throttle: e.median for throttle, e in fit.posterior.L_inf_N.items()}
    # keys of the file are rounded
    return np.array([known.get(float(f"{t:g}"), np.nan) for t in data.levels])[data.level]


def frame(parts: Sequence[Part], columns: Sequence[str]) -> pd.DataFrame:
    """Parts of a table, one below the other.

    A single value fills every row of its part. What a part lacks is empty there: nan among
    numbers, no text among texts.
    """
    tables = []
    for part in parts:
        size = max((len(v) for v in part.values() if np.ndim(v)), default=1)
        filled = {n: np.broadcast_to(v, (size,)) for n, v in part.items() if v is not None}
        tables.append(pd.DataFrame(filled))
    joined = pd.concat([pd.DataFrame(), *tables], ignore_index=True)
    joined = joined.reindex(columns=list(columns))
    texts = [name for name, column in joined.items() if column.dtype.kind == "O"]
    return joined.fillna(dict.fromkeys(texts, ""))


def pick(table: pd.DataFrame, **values: object) -> pd.DataFrame:
    """Rows in which these columns have these values, numbered from 0."""
    keep = np.ones(len(table), dtype=bool)
    for name, value in values.items():
        keep &= (table[name] == value).to_numpy()
    return table[keep].reset_index(drop=True)


def groups(table: pd.DataFrame, *columns: str) -> list[tuple[Any, ...]]:
    """Different combinations of values of these columns, in the order in which they come."""
    return records(table[list(columns)].drop_duplicates())


def records(table: pd.DataFrame) -> list[Any]:
    """Rows with their columns as attributes."""
    return list(table.itertuples(index=False))
