"""What summaries and pages read: the products of one campaign, already in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.errors import ProductError
from nearlift.manifest.campaign import Campaign, Overlay, boundaries_of
from nearlift.products import DIAGNOSIS, FIT, NOT_DIAGNOSED, RESULTS, Product
from nearlift.results import Observations
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.results.serial import decode

#: Column name -> values, all of one length; text columns are object arrays of str.
Columns = dict[str, NDArray[Any]]
#: The same, to be read.
Rows = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The products that exist, and what is needed to read them.

    Attributes
    ----------
    campaign : Campaign
    tables : mapping of str to Columns
        Table products by file name.
    documents : mapping of str to dict
        JSON products by file name.
    observations : mapping of Boundary to Observations
        The accepted trials of each boundary.
    overlays : tuple of (Overlay, Columns)
        Further data named in the manifest: `z_hat`, `delta_L`, `u` as fractions.
    digests : mapping of str to str
        SHA-256 of each product, by file name.
    inputs : mapping of str to str
        SHA-256 of each raw input, by path within the campaign.
    versions : mapping of str to str
        Of Python and the packages that can change a number.
    seed : int
    """

    campaign: Campaign
    tables: Mapping[str, Columns] = field(default_factory=dict)
    documents: Mapping[str, dict[str, object]] = field(default_factory=dict)
    observations: Mapping[Boundary, Observations] = field(default_factory=dict)
    overlays: tuple[tuple[Overlay, Columns], ...] = ()
    digests: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0

    def has(self, *products: Product) -> bool:
        """Whether all these products exist."""
        return all(p.file in self.tables or p.file in self.documents for p in products)

    def table(self, product: Product) -> Columns:
        """A table product; `ProductError` if it does not exist."""
        if product.file not in self.tables:
            raise ProductError(
                product.file,
                "is missing",
                "run the stage that writes it (`nearlift plan CAMPAIGN` says which)",
            )
        return self.tables[product.file]

    def document(self, product: Product) -> dict[str, Any]:
        """A JSON product; `ProductError` if it does not exist."""
        if product.file not in self.documents:
            raise ProductError(
                product.file,
                "is missing",
                "run the stage that writes it (`nearlift plan CAMPAIGN` says which)",
            )
        return self.documents[product.file]

    @property
    def boundaries(self) -> list[Boundary]:
        """The boundaries that were fitted, in the order ground, ceiling, sidewall."""
        return boundaries_of(self.document(FIT)["boundaries"])

    def base(self, boundary: Boundary) -> tuple[LiftModel, dict[str, Any]]:
        """The base model of a boundary and its entry in fit.json."""
        content = self.document(FIT)
        name = content["base"][boundary]
        return catalogue.model(name), content["boundaries"][boundary][name]

    def quoted(self, boundary: Boundary) -> BoundaryResult:
        """What is to be quoted of a boundary."""
        return decode(Results, self.document(RESULTS)).boundaries[boundary]

    def diagnosed(self, boundary: str) -> dict[str, Any]:
        """The loop's findings at a boundary; empty where there are none, as where it could not be
        diagnosed.
        """
        entry = self._block(boundary)
        return {} if entry.get("verdict") == NOT_DIAGNOSED else entry

    def not_diagnosed(self, boundary: str) -> str:
        """Why a boundary could not be diagnosed; empty where it was, or where nobody tried."""
        entry = self._block(boundary)
        return str(entry["reason"]) if entry.get("verdict") == NOT_DIAGNOSED else ""

    def _block(self, boundary: str) -> dict[str, object]:
        """A boundary's block of diagnosis.json; empty where there is none."""
        entry: dict[str, object] = (
            self.document(DIAGNOSIS).get("boundaries", {}).get(boundary, {})
            if self.has(DIAGNOSIS)
            else {}
        )
        return entry

    def known(self, boundary: Boundary, model: LiftModel) -> dict[str, Any]:
        """What `model` needs besides its parameters, one value for a whole curve: geometry, else
        the covariate's median.
        """
        geometry = self.campaign.vehicle.geometry()
        data = self.observations[boundary]
        own = {"throttle": data.throttle, **data.covariates}
        return {
            n: geometry[n] if n in geometry else float(np.nanmedian(own[n])) for n in model.needs
        }


def lift_inf_N(entry: dict[str, Any], data: Observations) -> FloatArray:
    """L_inf of each trial in N, by one entry of fit.json; nan at a throttle of which the fit took
    no trial.
    """
    if data.curve is not None:
        return data.lift_inf_N(np.array(entry["levels"]["coefficients"]))
    known = [entry["L_inf_N"].get(f"{t:g}", {"value": np.nan}) for t in data.levels]
    return np.array([e["value"] for e in known], dtype=float)[data.level]


def values(entry: dict[str, Any]) -> dict[str, float]:
    """The fitted parameters of one entry of fit.json."""
    return {name: float(e["value"]) for name, e in entry["parameters"].items()}


def stack(rows: list[Columns]) -> Columns:
    """Tables with the same columns, one below the other."""
    return {name: np.concatenate([r[name] for r in rows]) for name in rows[0]}


def select(table: Rows, rows: Any) -> Columns:
    """The rows of a mask."""
    return {name: column[rows] for name, column in table.items()}


def distinct(column: NDArray[Any]) -> list[Any]:
    """The values of a column, in the order in which they come."""
    return list(dict.fromkeys(column.tolist()))


def text_column(value: str, n: int) -> NDArray[Any]:
    """A text column that says the same in all its n rows."""
    return np.full(n, value, dtype=object)
