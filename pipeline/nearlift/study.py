"""Python interface: a campaign, its stages, and their products as DataFrames."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pandas as pd

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.isolation import library
from nearlift.likelihood.problem import usable
from nearlift.observed import observe
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results.diagnosis import BoundaryDiagnosis, DiagnosisResults, NotDiagnosed
from nearlift.results.estimate import Estimate
from nearlift.results.fit import FitResults
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.rounding import plain
from nearlift.run import engine, tables
from nearlift.stages import ORDER, PRODUCTS, STAGES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Entry = TypeVar("Entry")
#: Correlations printed, as in lmfit's report.
MIN_CORRELATION = 0.1
#: Columns of a table of coefficients that fits and diagnoses have.
ESTIMATE = ("value", "u", "dof", "lo90", "hi90", "unit")


class Study:
    """One campaign, its products and reports. Made by `nearlift.load` or `nearlift.trials`.

    Each method first runs the stages up to its own that are stale, as ``nearlift run`` does. Its
    answer depends on the campaign, not on what later stages have left on disk. Nothing is written
    into the campaign's folder.

    Attributes
    ----------
    root : Path
        The campaign's folder.
    manifest : Campaign
        ``campaign.toml``, checked and in SI.
    processed, reports : Path
        Folders of its products and figures.
    """

    def __init__(self, root: Path, out: Path, seed: int, executor: str) -> None:
        self.root, self.out, self.seed, self.executor = root, out, seed, executor
        self.manifest = manifests.load(root)
        self.processed = out / "processed" / self.manifest.name
        self.reports = out / "reports" / self.manifest.name

    def reduce(self) -> pd.DataFrame:
        """Reduce records to trials, and trials to the change of lift per cell: ``lift.parquet``.

        Cells share `L_inf`: their covariance is ``read("lift_covariance.parquet")``, in the same
        order along both axes.
        """
        self._run("reduce")
        return self.read("lift.parquet")

    def fit(self) -> Fit:
        """Fit every lift model that suits, by least squares and as a posterior.

        Raises
        ------
        NotConverged
            A base model does not converge, or two samplers of a posterior disagree.
        """
        about = self._run("fit")
        results = tables.load(self.processed / FitResults.file, FitResults)
        residuals = _residuals(about["trials"], self.manifest, results)
        posterior = self.read("posterior.parquet")
        return Fit(**about, results=results, residuals=residuals, posterior=posterior)

    def diagnose(self) -> Diagnosis:
        """Trace the residuals of the base models to an identified effect, or to none."""
        about, folder = self._run("diagnose"), self.processed
        return Diagnosis(
            **about,
            boundaries=tables.load(folder / DiagnosisResults.file, DiagnosisResults).boundaries,
            quoted=tables.load(folder / Results.file, Results).boundaries,
            residuals=self.read("loop_residuals.parquet"),
        )

    def run(self) -> Path:
        """Run every stage that is stale, as ``nearlift run`` does; the path of the report."""
        self._run("report")
        return self.reports / "index.html"

    def plot(self, name: str = "fig2") -> Figure:
        """Draw a figure of the report as a matplotlib Figure, to be adjusted and saved.

        `name` is such as ``"fig2"``, ``"diagnosis"``, ``"residuals"``, ``"corner"``.

        Raises
        ------
        UsageError
            There is no such figure, or this campaign does not have what it shows.
        """
        from nearlift.report.figures.files import drawn
        from nearlift.report.registry import FIGURES
        from nearlift.stages.gathering import gather

        spec = _entry({item.name: item for item in FIGURES}, name, "is no figure")
        self._run([stage.name for stage in STAGES if set(stage.writes) & set(spec.needs)][-1])
        with self._job("serial") as job:
            rows = spec.table(gather(job))
        if rows.empty:
            what = "cannot be drawn: this campaign does not have what it shows"
            raise UsageError(name, what, "`nearlift run --dry-run CAMPAIGN` lists its stages")
        return drawn(spec.draw, rows, self.manifest.simulated)

    def read(self, product: str) -> pd.DataFrame:
        """Read a table product from disk, such as ``"trials.parquet"``, its checksums verified;
        ``nearlift describe`` lists them.

        Raises
        ------
        UsageError
            There is no such product, or it is no table.
        ProductError
            It is missing or damaged.
        """
        by_name = {p.file: p for p in PRODUCTS if p.file.endswith(".parquet")}
        known = _entry(by_name, product, "is no table product")
        return pd.DataFrame(tables.read_table(self.processed / product, known))

    def _job(self, executor: str) -> contextlib.AbstractContextManager[engine.Job]:
        return engine.open_job(self.root, self.out, STAGES, executor, self.seed)

    def _run(self, last: str) -> dict[str, Any]:
        """Run what is stale up to the stage `last`; the fields of every answer."""
        with self._job(self.executor) as job:
            steps = [*engine.run(job, STAGES[: ORDER.index(last) + 1])]
        notes = tuple(dict.fromkeys(note for step in steps for note in step.outcome.notes))
        trials = self.read("trials.parquet")
        return {"campaign": self.manifest.name, "trials": trials, "notes": notes}

    def __repr__(self) -> str:
        return f"Study({self.manifest.name!r}, {str(self.root)!r}, out={str(self.out)!r})"


def load(
    campaign: str | Path, out: str | Path = ".", *, seed: int = 0, executor: str = "threads:2"
) -> Study:
    """Open a campaign; its manifest is checked, nothing is run yet.

    Parameters
    ----------
    campaign : path
        Its folder.
    out : path
        The folder that holds ``processed/`` and ``reports/``.
    seed : int
        Seed of everything random.
    executor : str
        ``serial``, ``threads:N``, ``processes:N`` or ``dask:ADDRESS``.

    Raises
    ------
    ManifestError
        ``campaign.toml`` is missing or breaks the contract; every fault is listed.
    """
    return Study(Path(campaign), Path(out), seed, executor)


def trials(
    frame: pd.DataFrame,
    *,
    rotor_radius: str,
    mass: str,
    rotors: int = 4,
    rotor_spacing: str | None = None,
    held: str = "throttle",
    name: str = "trials",
    seed: int = 0,
    **sections: Any,
) -> Study:
    """Study of a table of trials, without files.

    Parameters
    ----------
    frame : DataFrame
        A trial a row, with the columns of ``trials.parquet`` in SI. They are ``boundary``,
        ``z_m``, ``throttle`` (a fraction) and ``lift_N``. Where known, add ``u_lift_N``, ``n``,
        ``sd_N``, ``visit``, ``start_s``, ``session``, ``supply_V`` and the like. A column may
        have another unit at the end of its name: ``z_mm``, ``throttle_percent``, ``lift_gf``.
        Free-air trials have the boundary ``none`` and an infinite or empty distance. Rows with a
        rejecting `quality` are left out.
    rotor_radius, mass, rotor_spacing : str
        With unit, such as ``"23 mm"``. The spacing is between adjacent axes.
    rotors : int
        Number of rotors; 1 for an isolated rotor.
    held : str
        Held quantity: ``throttle``, ``voltage``, ``rpm`` or ``power``.
    **sections : mapping, list or value
        Other keys of the manifest, such as ``fit={"ground": {"rivals": []}}``, ``simulated=True``
        or ``uncertainty=[{"name": "datum", "on": "height", "value": "0.1 mm", "scope":
        "boundary"}]``.

    Raises
    ------
    UsageError
        A column is missing or has a unit that is not known.
    ManifestError
        A value breaks the contract.

    Notes
    -----
    Records give one standard error per trial (`u_lift_N`); it is stated as the standard deviation
    of a single mean. Products are kept in a temporary folder as long as the study is.
    """
    from nearlift.onboarding.frames import write_campaign

    vehicle = {"name": name, "rotors": rotors, "rotor_radius": rotor_radius, "mass": mass}
    vehicle["rotor_spacing"] = rotor_spacing
    folder = Path(tempfile.mkdtemp(prefix="nearlift-"))
    with contextlib.ExitStack() as refused:
        refused.callback(shutil.rmtree, folder, ignore_errors=True)
        root = write_campaign(folder, frame, vehicle, held, sections)
        study = Study(root, folder, seed, "serial")
        weakref.finalize(study, refused.pop_all().close)
    return study


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StudyAnswer:
    """Answer of a study, shown as a report.

    Attributes
    ----------
    campaign : str
        Its name.
    trials : DataFrame
        A trial a row, in run order: ``trials.parquet``. `quality` says which were rejected.
    notes : tuple of str
        Notes of the stages that ran.
    """

    campaign: str
    trials: pd.DataFrame
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return str(self)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Fit(StudyAnswer):
    """Every model at every boundary, before any diagnosis: ``fit.json`` and ``posterior.parquet``.

    These are the coefficients if the model were right and no effect missing. The number to quote is
    `Study.diagnose`'s. Methods that take a boundary and a model take the first boundary and its
    base model where none is named.

    Attributes
    ----------
    results : FitResults
        ``fit.json``; ``results.of_base("ground")`` is the fit of the base model.
    residuals : DataFrame
        Log lift less the base model's, an accepted trial a row, with the columns of `trials`; nan
        outside the model's range. Free-air trials appear once for each boundary, `fitted_at`.
    posterior : DataFrame
        Draws of all models: a draw of one parameter a row.
    """

    results: FitResults
    residuals: pd.DataFrame
    posterior: pd.DataFrame

    @property
    def coefficients(self) -> pd.DataFrame:
        """A coefficient of a model a row; `base` marks the base models."""
        rows = [
            {"boundary": boundary, "model": model, "base": model == self.results.base[boundary]}
            | {"coefficient": name, **{key: getattr(c, key) for key in ESTIMATE}}
            for boundary, models in self.results.boundaries.items()
            for model, fit in models.items()
            for name, c in fit.parameters.items()
        ]
        return pd.DataFrame(rows)

    def draws(self, boundary: str = "", model: str = "") -> pd.DataFrame:
        """Posterior draws of a model: a draw a row, a parameter a column."""
        boundary, model = self._chosen(boundary, model)
        drawn = self.posterior.query("boundary == @boundary and model == @model")
        if drawn.empty:
            what = f"there are none at the {boundary}"
            remedy = "its posterior was not reached: see `notes`"
            raise UsageError(f"draws of {model}", what, remedy)
        index = ["chain", "draw"]
        return drawn.pivot_table(index=index, columns="parameter", values="value", sort=False)

    def to_lmfit(self, boundary: str = "", model: str = "") -> Any:
        """Coefficients as `lmfit.Parameters`, with bounds, standard errors and correlations."""
        boundary, model = self._chosen(boundary, model)
        fit = self.results.boundaries[boundary][model]
        parameters = library("lmfit").Parameters()
        for name, c in fit.parameters.items():
            low, high = catalogue.model(model).parameter(name).bounds
            parameters.add(name, value=c.value, min=low, max=high)
            parameters[name].stderr, parameters[name].correl = c.u, {}
        for (a, b), r in _correlations(fit.covariance.names, fit.covariance.values).items():
            if a in parameters and b in parameters:
                parameters[a].correl[b] = parameters[b].correl[a] = r
        return parameters

    def to_arviz(self, boundary: str = "", model: str = "") -> Any:
        """Posterior draws as ArviZ's InferenceData; `UsageError` where ArviZ is not installed."""
        try:
            import arviz
        except ImportError:
            remedy = "pip install 'nearlift[arviz]'"
            raise UsageError("to_arviz", "needs the package arviz", remedy) from None
        draws = self.draws(boundary, model)
        # chains may differ in length by a draw
        wide = draws.unstack("chain").dropna()
        return arviz.from_dict(posterior={str(n): wide[n].to_numpy().T for n in draws.columns})

    def _chosen(self, boundary: str, model: str) -> tuple[Boundary, str]:
        bases = self.results.base
        where = next((b for b in bases if b == boundary or not boundary), None)
        if where is None:
            raise UsageError(repr(boundary), "was not fitted", f"there are {', '.join(bases)}")
        model = model or bases[where]
        _entry(self.results.boundaries[where], model, f"was not fitted at the {where}")
        return where, model

    def __str__(self) -> str:
        lines = [self.campaign]
        for boundary in self.results.base:
            fit = self.results.of_base(boundary)
            quality = f"chi2/dof = {plain(fit.chi2 / fit.dof, 3)}, dof = {fit.dof}"
            facts = [f"trials = {fit.n_trials}, {quality}, rmse = {100 * fit.rmse:.2g} %"]
            correlations = _correlations(fit.covariance.names, fit.covariance.values)
            lines += _section(boundary, fit.title, facts, fit.parameters, correlations)
        return "\n".join([*lines, "Not diagnosed; the number to quote is diagnose()'s."])


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Diagnosis(StudyAnswer):
    """Diagnosis of every boundary, and the numbers to quote.

    Attributes
    ----------
    boundaries : mapping of str to BoundaryDiagnosis or NotDiagnosed
        ``diagnosis.json``, by boundary.
    quoted : mapping of str to BoundaryResult
        ``results.json``: verdict, effects with sizes, coefficients and doubts by boundary.
    residuals : DataFrame
        Residuals before and after the identified effects, held out and not:
        ``loop_residuals.parquet``.
    """

    boundaries: Mapping[Boundary, BoundaryDiagnosis | NotDiagnosed]
    quoted: Mapping[Boundary, BoundaryResult]
    residuals: pd.DataFrame

    @property
    def coefficients(self) -> pd.DataFrame:
        """A coefficient to quote a row, with verdict and identified effects."""
        keys = (*ESTIMATE, "lo68", "hi68", "lo95", "hi95", "holds")
        rows = [
            {"boundary": boundary, "model": result.base_model, "verdict": result.verdict}
            | {"effects": " + ".join(result.effects), "coefficient": name}
            | {key: getattr(c, key) for key in keys}
            for boundary, result in self.quoted.items()
            for name, c in result.coefficients.items()
        ]
        return pd.DataFrame(rows)

    def __str__(self) -> str:
        lines = [self.campaign]
        for boundary, result in self.quoted.items():
            why = f", {result.reason}" if result.reason else ""
            facts = [f"verdict: {claim(result, self.boundaries.get(boundary))}{why}"]
            for size in result.sizes:
                unit = f" {size.unit}" if size.unit != "1" else ""
                value, low, high = (plain(x, 3) for x in (size.value, size.lo90, size.hi90))
                sized = f"{size.parameter} = {value}{unit} (90 %: {low} to {high})"
                facts.append(f"{size.effect}: {sized}")
            if (error := result.error) is not None:
                before, after = f"{100 * error.before:.2g} %", f"{100 * error.after:.2g} %"
                facts.append(f"cross-validated error: {before} before, {after} after")
            title = catalogue.model(result.base_model).title
            correlations = _correlations(result.correlation.parameters, result.correlation.values)
            lines += _section(boundary, title, facts, result.coefficients, correlations)
        return "\n".join(lines)


def _residuals(
    trials: pd.DataFrame, campaign: manifests.Campaign, results: FitResults
) -> pd.DataFrame:
    """Log lift less that of the base model of each boundary, with the columns of `trials`."""
    from nearlift.report.curves import log_residual

    columns = {str(name): values.to_numpy() for name, values in trials.items()}
    parts = []
    for boundary, base in results.base.items():
        model, data = catalogue.model(base), observe(columns, campaign, boundary)
        inside = data.take(usable(model, data))
        left = log_residual(model, results.of_base(boundary), inside)
        rows = trials[trials["trial"].isin(data.trial)]
        rows = rows.assign(residual=rows["trial"].map(pd.Series(left, index=inside.trial)))
        rows.insert(0, "fitted_at", boundary)
        parts.append(rows)
    return pd.concat(parts, ignore_index=True)


def _entry(entries: Mapping[str, Entry], key: str, what: str) -> Entry:
    if key not in entries:
        raise UsageError(key, what, f"there are {', '.join(entries)}")
    return entries[key]


def _correlations(
    names: Sequence[str], values: Sequence[Sequence[float]]
) -> dict[tuple[str, str], float]:
    """Correlations of pairs, the largest first, from a covariance or a correlation matrix."""
    matrix = np.array(values, dtype=float).reshape(len(names), len(names))
    sd = np.sqrt(matrix.diagonal())
    pairs = {
        (names[i], names[j]): float(matrix[i, j] / sd[i] / sd[j])
        for i in range(len(sd))
        for j in range(i)
    }
    return dict(sorted(pairs.items(), key=lambda pair: -abs(pair[1])))


def _section(
    boundary: str,
    title: str,
    facts: list[str],
    coefficients: Mapping[str, Estimate],
    correlations: Mapping[tuple[str, str], float],
) -> list[str]:
    """Lines of one boundary in a report, in the form of lmfit's."""
    values = [coefficient_text(c, name) for name, c in coefficients.items()]
    pairs = [
        f"C({a}, {b}) = {r:+.3f}" for (a, b), r in correlations.items() if abs(r) > MIN_CORRELATION
    ]
    return [f"[[{boundary}: {title}]]", *(f"    {text}" for text in (*facts, *values, *pairs))]
