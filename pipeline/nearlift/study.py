"""Python interface: a campaign, its stages and its products."""

from __future__ import annotations

import contextlib
import functools
import shutil
import tempfile
import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.isolation import library
from nearlift.likelihood.problem import usable
from nearlift.observed import observe
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis, DiagnosisResults, NotDiagnosed
from nearlift.results.fit import FitResults, ModelFit
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.rounding import plain, plus_minus
from nearlift.run import engine, tables
from nearlift.run.tables import Product
from nearlift.stages import ORDER, PRODUCTS, STAGES
from nearlift.stages.diagnose import LOOP_RESIDUALS
from nearlift.stages.fit import POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Entry = TypeVar("Entry")
#: Rejected trials printed by name; more are counted.
MAX_REJECTED_LISTED = 5
#: Correlations printed, as in lmfit's report.
MIN_CORRELATION = 0.1


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

    @property
    def name(self) -> str:
        """Name of the campaign and of the folders of its products."""
        return self.manifest.name

    @property
    def report(self) -> Path:
        """Path of ``index.html``, which `run` writes."""
        return self.reports / "index.html"

    def reduce(self) -> Reduction:
        """Reduce raw records to trials, and trials to the change of lift per cell."""
        import pandas as pd

        about = self._about("reduce")
        cells, covariance = self.read(LIFT), self.read(LIFT_COVARIANCE)
        if len(covariance):
            places = cells[["boundary", "z_hat", "throttle"]]
            covariance.index = covariance.columns = pd.MultiIndex.from_frame(places)
        return Reduction(**about, trials=self.read(TRIALS), cells=cells, covariance=covariance)

    def fit(self) -> Fit:
        """Fit every lift model that suits, by least squares and as a posterior.

        Raises
        ------
        NotConverged
            A base model does not converge, or two samplers of a posterior disagree.
        """
        about = self._about("fit")
        results = self._load(FitResults)
        trials = self.read(TRIALS)
        columns = {str(name): values.to_numpy() for name, values in trials.items()}
        return Fit(
            **about,
            boundaries={
                boundary: BoundaryFit(
                    boundary=boundary, base_model=results.base[boundary], models=models
                )
                for boundary, models in results.boundaries.items()
            },
            trials=trials,
            observations={b: observe(columns, self.manifest, b) for b in results.boundaries},
            posterior=self.read(POSTERIOR),
        )

    def diagnose(self) -> Diagnosis:
        """Trace the residuals of the base models to an identified effect, or to none."""
        about = self._about("diagnose")
        return Diagnosis(
            **about,
            boundaries=self._load(DiagnosisResults).boundaries,
            quoted=self._load(Results).boundaries,
            trials=self.read(TRIALS),
            residuals=self.read(LOOP_RESIDUALS),
        )

    def run(self) -> Path:
        """Run every stage that is stale, as ``nearlift run`` does; the path of the report."""
        self._about("report")
        return self.report

    def plan(self) -> dict[str, str]:
        """Reason why each stage is stale, empty if it is up to date; runs nothing."""
        with self._open("serial") as job:
            return {stage.name: why for stage, why in engine.plan(job)}

    def plot(self, name: str = "fig2") -> Figure:
        """Draw a figure of the report as a matplotlib Figure, to be adjusted and saved.

        Parameters
        ----------
        name : str
            Such as ``"fig2"``, ``"diagnosis"``, ``"budget"``, ``"residuals"``, ``"corner"``.

        Raises
        ------
        UsageError
            There is no such figure, or this campaign does not have what it shows.
        """
        from nearlift.report.figures.files import drawn
        from nearlift.report.figures.style import style_of
        from nearlift.report.registry import FIGURES
        from nearlift.stages.gathering import gather

        spec = {item.name: item for item in FIGURES}.get(name)
        if spec is None:
            raise UsageError(
                name, "is no figure", f"there are {', '.join(item.name for item in FIGURES)}"
            )
        makers = [stage.name for stage in STAGES if set(stage.writes) & set(spec.needs)]
        self._about(makers[-1])
        with self._open("serial") as job:
            evidence = gather(job)
        rows = spec.table(evidence)
        if rows.empty:
            raise UsageError(
                name,
                "cannot be drawn: this campaign does not have what it shows",
                "`plan()` says which stages belong to it",
            )
        return drawn(spec.draw, rows, style_of(self.manifest))

    def read(self, product: Product | str) -> pd.DataFrame:
        """Read a table product from disk, its checksums verified.

        Parameters
        ----------
        product : str
            Such as ``"trials.parquet"``; ``nearlift describe`` lists them.

        Raises
        ------
        UsageError
            There is no such product, or it is no table.
        ProductError
            It is missing or damaged.
        """
        import pandas as pd

        if isinstance(product, str):
            by_name = {p.file: p for p in PRODUCTS if p.file.endswith(".parquet")}
            if product not in by_name:
                raise UsageError(product, "is no table product", f"there are {', '.join(by_name)}")
            product = by_name[product]
        return pd.DataFrame(tables.read_table(self.processed / product.file, product))

    def _load(self, kind: type[tables.Loaded]) -> tables.Loaded:
        return tables.load(self.processed / kind.file, kind)

    def _open(self, executor: str) -> contextlib.AbstractContextManager[engine.Job]:
        return engine.open_job(self.root, self.out, STAGES, executor, self.seed)

    def _about(self, last: str) -> dict[str, Any]:
        """Run what is stale up to the stage `last`: the name, rejected trials and notes."""
        with self._open(self.executor) as job:
            steps = list(engine.run(job, STAGES[: ORDER.index(last) + 1]))
        rejected = tuple(r for step in steps for r in step.outcome.rejected)
        notes = tuple(dict.fromkeys(note for step in steps for note in step.outcome.notes))
        return {"campaign": self.name, "rejected": rejected, "notes": notes}

    def __repr__(self) -> str:
        return f"Study({self.name!r}, {str(self.root)!r}, out={str(self.out)!r})"


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
    **sections: Mapping[str, Any],
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
        Quantity that a trial holds constant: ``throttle``, ``voltage``, ``rpm`` or ``power``.
    name : str
        Name of the campaign.
    seed : int
        Seed of everything random.
    **sections : mapping
        Other sections of the manifest, such as ``fit={"ground": {"rivals": []}}``.

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
    from nearlift.onboarding.frames import columns_of, write_campaign

    vehicle = {
        "name": name,
        "rotors": rotors,
        "rotor_radius": rotor_radius,
        "rotor_spacing": rotor_spacing,
        "mass": mass,
    }
    columns = columns_of(frame)
    folder = Path(tempfile.mkdtemp(prefix="nearlift-"))
    remove = functools.partial(shutil.rmtree, folder, ignore_errors=True)
    try:
        root = write_campaign(folder, frame, columns, name, vehicle, held, sections)
        study = Study(root, folder, seed, "serial")
    except Exception:
        remove()
        raise
    weakref.finalize(study, remove)
    return study


@dataclass(frozen=True, kw_only=True, repr=False)
class StudyAnswer:
    """Answer of a study, printed as a report.

    Attributes
    ----------
    campaign : str
        Its name.
    rejected : tuple of (str, str)
        Trials that take no part in fits, each with its reason.
    notes : tuple of str
        Notes of the stages that ran.
    """

    campaign: str
    rejected: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return str(self)


@dataclass(frozen=True, kw_only=True, repr=False)
class Reduction(StudyAnswer):
    """Trials reduced to cells.

    Attributes
    ----------
    trials : DataFrame
        A trial a row, in run order, rejected ones included: ``trials.parquet``.
    cells : DataFrame
        Change of lift per boundary, distance and throttle: ``lift.parquet``.
    covariance : (n, n) DataFrame
        Covariance of `delta_L`, in the order of `cells` along both axes. Cells share `L_inf`, so it
        is not diagonal. Empty beyond 2000 cells.
    """

    trials: pd.DataFrame = field(compare=False)
    cells: pd.DataFrame = field(compare=False)
    covariance: pd.DataFrame = field(compare=False)

    def __str__(self) -> str:
        lines = [self.campaign]
        for boundary, cells in self.cells.groupby("boundary", sort=False):
            top = cells.iloc[int(cells["delta_L"].abs().argmax())]
            change = plus_minus(100 * top["delta_L"], 100 * top["u_delta_L"])
            lines.append(
                f"{boundary}: {cells['n_trials'].sum()} trials in {len(cells)} cells, largest ΔL"
                f" {change} % at {plain(top['z_hat'], 3)} radii"
            )
        lines += [f"{trial}: {reason}" for trial, reason in self.rejected[:MAX_REJECTED_LISTED]]
        if len(self.rejected) > MAX_REJECTED_LISTED:
            lines.append(f"and {len(self.rejected) - MAX_REJECTED_LISTED} more trials rejected")
        return "\n".join([*lines, *self.notes])


@dataclass(frozen=True, kw_only=True, repr=False)
class ByBoundary(StudyAnswer, Generic[Entry]):
    """Answer with an entry for each boundary: ground, ceiling, sidewall."""

    boundaries: Mapping[Boundary, Entry]

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.boundaries.values())

    def __getitem__(self, boundary: str) -> Entry:
        return _entry(self.boundaries, boundary, f"{boundary!r} is no boundary of this campaign")


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryFit:
    """Every model of one boundary; the loop tests the base model."""

    boundary: Boundary
    base_model: str
    models: Mapping[str, ModelFit]

    @property
    def base(self) -> ModelFit:
        """Fit of the base model."""
        return self.models[self.base_model]

    def __getitem__(self, model: str) -> ModelFit:
        return _entry(self.models, model, f"no fit of {model!r} at the {self.boundary}")


@dataclass(frozen=True, kw_only=True, repr=False)
class Fit(ByBoundary[BoundaryFit]):
    """Every model at every boundary, before any diagnosis: ``fit.json`` and ``posterior.parquet``.

    These are the coefficients if the model were right and no effect missing. The number to quote is
    `Study.diagnose`'s.
    """

    trials: pd.DataFrame = field(compare=False)
    observations: Mapping[Boundary, Observations] = field(compare=False)
    posterior: pd.DataFrame = field(compare=False)

    @property
    def coefficients(self) -> pd.DataFrame:
        """A coefficient of a model a row; `base` marks the base models."""
        import pandas as pd

        rows = [
            {"boundary": at.boundary, "model": model, "base": model == at.base_model}
            | {"coefficient": name}
            | {key: getattr(c, key) for key in ("value", "u", "dof", "lo90", "hi90", "unit")}
            for at in self
            for model, fit in at.models.items()
            for name, c in fit.coefficients.items()
        ]
        return pd.DataFrame(rows)

    @property
    def residuals(self) -> pd.DataFrame:
        """Log lift less the base model's, an accepted trial a row, with the columns of `trials`.

        Free-air trials appear once per boundary. nan outside the model's range.
        """
        import pandas as pd

        from nearlift.report.curves import log_residual

        parts = []
        for at in self:
            model, data = catalogue.model(at.base_model), self.observations[at.boundary]
            inside = data.take(usable(model, data))
            residual = dict(zip(inside.trial, log_residual(model, at.base, inside), strict=True))
            rows = self.trials[self.trials["trial"].isin(data.trial)].copy()
            rows["residual"] = rows["trial"].map(residual).astype(float)
            rows.insert(0, "fitted_at", at.boundary)
            parts.append(rows)
        return pd.concat(parts, ignore_index=True)

    def draws(self, boundary: str, model: str | None = None) -> pd.DataFrame:
        """Posterior draws of the base model, or of another: a draw a row, a parameter a column."""
        model = model or self[boundary].base_model
        self[boundary][model]  # refuses a model that was not fitted
        of_model = (self.posterior["boundary"] == boundary) & (self.posterior["model"] == model)
        if not of_model.any():
            raise UsageError(
                f"draws of {model}",
                f"there are none at the {boundary}",
                "its posterior was not reached: see `notes`",
            )
        return self.posterior[of_model].pivot_table(
            index=["chain", "draw"], columns="parameter", values="value", sort=False
        )

    def to_lmfit(self, boundary: str, model: str | None = None) -> Any:
        """Coefficients as `lmfit.Parameters`, with bounds, standard errors and correlations."""
        parameters = library("lmfit").Parameters()
        model = model or self[boundary].base_model
        fit = self[boundary][model]
        for name, c in fit.coefficients.items():
            low, high = catalogue.model(model).parameter(name).bounds
            parameters.add(name, value=c.value, min=low, max=high)
            parameters[name].stderr = c.u
        for a, b, r in _correlations(fit.covariance.names, fit.covariance.values):
            if a in parameters and b in parameters:
                parameters[a].correl = (parameters[a].correl or {}) | {b: r}
                parameters[b].correl = (parameters[b].correl or {}) | {a: r}
        return parameters

    def to_arviz(self, boundary: str, model: str | None = None) -> Any:
        """Posterior draws as ArviZ's InferenceData; `UsageError` where ArviZ is not installed."""
        try:
            import arviz
        except ImportError:
            raise UsageError(
                "to_arviz", "needs the package arviz", "pip install 'nearlift[arviz]'"
            ) from None
        draws = self.draws(boundary, model)
        chains = [chain.to_numpy().T for _, chain in draws.groupby(level="chain", sort=False)]
        length = min(chain.shape[1] for chain in chains)
        names = map(str, draws.columns)
        return arviz.from_dict(
            posterior={n: [chain[i, :length] for chain in chains] for i, n in enumerate(names)}
        )

    def __str__(self) -> str:
        lines = [self.campaign]
        for at in self:
            fit = at.base
            quality = f"chi2/dof = {plain(fit.chi2 / fit.dof, 3)}, dof = {fit.dof}"
            lines.append(f"[[{at.boundary}: {fit.title}]]")
            lines.append(f"    trials = {fit.n_trials}, {quality}, rmse = {100 * fit.rmse:.2g} %")
            lines += [f"    {coefficient_text(c, name)}" for name, c in fit.coefficients.items()]
            lines += _correlation_lines(fit.covariance.names, fit.covariance.values)
        return "\n".join([*lines, "Not diagnosed; the number to quote is diagnose()'s."])


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis(ByBoundary[BoundaryDiagnosis | NotDiagnosed]):
    """Diagnosis of every boundary: ``diagnosis.json``, and the numbers to quote: ``results.json``.

    Attributes
    ----------
    quoted : mapping of str to BoundaryResult
        Verdict, effects with sizes, coefficients and doubts by boundary.
    trials : DataFrame
        ``trials.parquet``.
    residuals : DataFrame
        Residuals before and after the identified effects, held out and not:
        ``loop_residuals.parquet``.
    """

    quoted: Mapping[Boundary, BoundaryResult]
    trials: pd.DataFrame = field(compare=False)
    residuals: pd.DataFrame = field(compare=False)

    @property
    def coefficients(self) -> pd.DataFrame:
        """A coefficient to quote a row, with verdict and identified effects."""
        import pandas as pd

        keys = ("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95", "unit")
        rows = [
            {"boundary": boundary, "model": result.base_model, "verdict": result.verdict}
            | {"effects": " + ".join(result.effects), "coefficient": name}
            | {key: getattr(c, key) for key in (*keys, "holds")}
            for boundary, result in self.quoted.items()
            for name, c in result.coefficients.items()
        ]
        return pd.DataFrame(rows)

    def __str__(self) -> str:
        lines = [self.campaign]
        for boundary, result in self.quoted.items():
            lines.append(f"[[{boundary}: {catalogue.model(result.base_model).title}]]")
            why = f", {result.reason}" if result.reason else ""
            lines.append(f"    verdict: {claim(result, self.boundaries.get(boundary))}{why}")
            for size in result.sizes:
                unit = f" {size.unit}" if size.unit != "1" else ""
                value, low, high = (plain(x, 3) for x in (size.value, size.lo90, size.hi90))
                sized = f"{size.parameter} = {value}{unit} (90 %: {low} to {high})"
                lines.append(f"    {size.effect}: {sized}")
            if (error := result.error) is not None:
                before, after = f"{100 * error.before:.2g} %", f"{100 * error.after:.2g} %"
                lines.append(f"    cross-validated error: {before} before, {after} after")
            lines += [f"    {coefficient_text(c, name)}" for name, c in result.coefficients.items()]
            if (given := result.correlation) is not None:
                lines += _correlation_lines(given.parameters, given.values)
        return "\n".join(lines)


def _entry(entries: Mapping[Any, Entry], key: str, what: str) -> Entry:
    if key not in entries:
        raise UsageError(key, what, f"there are {', '.join(map(str, entries)) or 'none'}")
    return entries[key]


def _correlations(names: Any, values: Any) -> list[tuple[str, str, float]]:
    """Correlations of pairs, from a covariance or a correlation matrix, the largest first."""
    import numpy as np

    matrix = np.array(values, dtype=float).reshape(len(names), len(names))
    matrix /= np.sqrt(np.outer(matrix.diagonal(), matrix.diagonal()))
    pairs = [(names[i], names[j], float(matrix[i, j])) for i in range(len(names)) for j in range(i)]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def _correlation_lines(names: Any, values: Any) -> list[str]:
    pairs = _correlations(names, values)
    return [f"    C({a}, {b}) = {r:+.3f}" for a, b, r in pairs if abs(r) > MIN_CORRELATION]
