"""A campaign opened for work: the command line's stages, ledger and products, from Python."""

from __future__ import annotations

import contextlib
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.campaign import manifest as manifests
from nearlift.errors import UsageError
from nearlift.results.diagnosis import DiagnosisResults
from nearlift.results.fit import FitResults
from nearlift.results.quotation import Results
from nearlift.run import engine, tables
from nearlift.run.tables import Product
from nearlift.stages import ORDER, PRODUCTS, STAGES
from nearlift.stages.fit import POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE
from nearlift.study.answers import (
    AboutRun,
    BoundaryFit,
    Diagnosis,
    Drawing,
    Finished,
    Fit,
    Reduction,
)

if TYPE_CHECKING:
    import pandas as pd


class Study:
    """One campaign, its products and reports. Made by `nearlift.load`.

    Each method brings the stages up to and including its own up to date, as ``nearlift run`` would,
    and answers from the products; what is up to date does not run again. Nothing is ever written
    into the campaign's folder.

    Attributes
    ----------
    root : Path
        The campaign's folder.
    manifest : Campaign
        ``campaign.toml``, checked and in SI.
    processed, reports : Path
        Where its products and figures go.
    """

    def __init__(self, root: Path, out: Path, seed: int, executor: str) -> None:
        self.root, self.out, self.seed, self.executor = root, out, seed, executor
        self.manifest = manifests.load(root)
        self.processed = out / "processed" / self.manifest.name
        self.reports = out / "reports" / self.manifest.name

    @property
    def name(self) -> str:
        """The campaign's name, which names the folders of its products."""
        return self.manifest.name

    @property
    def report(self) -> Path:
        """``index.html``; it is there once `run` has made it."""
        return self.reports / "index.html"

    def reduce(self) -> Reduction:
        """Raw records to trials, and trials to the change of lift per cell."""
        import pandas as pd

        _, about = self._steps("reduce")
        cells, covariance = self.read(LIFT), self.read(LIFT_COVARIANCE)
        if len(covariance):
            places = cells[["boundary", "z_hat", "throttle"]]
            covariance.index = covariance.columns = pd.MultiIndex.from_frame(places)
        return Reduction(**about, trials=self.read(TRIALS), cells=cells, covariance=covariance)

    def fit(self) -> Fit:
        """Every lift model that suits, by least squares and as a posterior.

        Raises
        ------
        NotConverged
            A base model does not converge, or two samplers of a posterior disagree.
        """
        _, about = self._steps("fit")
        results = self._load(FitResults)
        boundaries = {
            boundary: BoundaryFit(
                boundary=boundary, base_model=results.base[boundary], models=models
            )
            for boundary, models in results.boundaries.items()
        }
        return Fit(
            **about,
            drawing=self.figure("fig2", bring=False),
            boundaries=boundaries,
            quoted=self._load(Results).boundaries,
            posterior=self.read(POSTERIOR),
        )

    def diagnose(self) -> Diagnosis:
        """The loop: what the base models leave, traced to a named effect, or not."""
        _, about = self._steps("diagnose")
        boundaries = self._load(DiagnosisResults).boundaries
        drawn = any(not at.reason for at in boundaries.values())
        return Diagnosis(
            **about,
            drawing=self.figure("diagnosis", bring=False) if drawn else None,
            boundaries=boundaries,
            quoted=self._load(Results).boundaries,
        )

    def run(self) -> Finished:
        """Every stage that is stale, the report last: what ``nearlift run`` does."""
        steps, about = self._steps("report")
        return Finished(
            **about, report=self.report, ran=tuple(step.stage.name for step in steps if step.why)
        )

    def plan(self) -> dict[str, str]:
        """Each stage with the reason for which it is stale, empty if it is up to date; runs
        nothing.
        """
        with self._open("serial", keep=False) as job:
            return {stage.name: why for stage, why in engine.plan(job)}

    def figure(self, name: str = "fig2", *, bring: bool = True) -> Drawing:
        """A figure of the report, drawn from the products as they are.

        Parameters
        ----------
        name : str
            Such as ``"fig2"``, ``"diagnosis"``, ``"budget"``, ``"residuals"``, ``"corner"``.
        bring : bool
            Bring the stages that it reads up to date first.

        Raises
        ------
        UsageError
            There is no such figure, or this campaign does not have what it shows.
        """
        from nearlift.report.figures.files import render
        from nearlift.report.figures.style import style_of
        from nearlift.report.registry import FIGURES
        from nearlift.stages.gathering import gather

        spec = {item.name: item for item in FIGURES}.get(name)
        if spec is None:
            raise UsageError(
                name, "is no figure", f"there are {', '.join(item.name for item in FIGURES)}"
            )
        if bring:
            makers = [stage.name for stage in STAGES if set(stage.writes) & set(spec.needs)]
            self._steps(makers[-1])
        with self._open("serial", keep=False) as job:
            evidence = gather(job)
        rows = spec.summarise(evidence) if evidence.has(*spec.needs) else {}
        if not any(len(column) for column in rows.values()):
            raise UsageError(
                name,
                "cannot be drawn: this campaign does not have what it shows",
                "`plan()` says which stages belong to it",
            )
        files = render(spec.draw, rows, style_of(self.manifest))
        words = {"caption": spec.caption(evidence, rows), "alt": spec.alt(evidence, rows)}
        return Drawing(
            name=name, title=spec.title, **words, png=files["png"], pdf=files["pdf"], table=rows
        )

    def read(self, product: Product | str) -> pd.DataFrame:
        """A table product as it stands on the disk, verified; `nearlift describe` lists their
        names, such as ``"trials.parquet"``.

        Raises
        ------
        UsageError
            There is no such product, or it is no table.
        ProductError
            It is missing or damaged.
        """
        import pandas as pd

        if isinstance(product, str):
            by_name = {
                name: p
                for p in PRODUCTS
                if p.file.endswith(".parquet")
                for name in (p.file, p.name)
            }
            if product not in by_name:
                raise UsageError(
                    product,
                    "is no table product",
                    f"there are {', '.join(n for n in by_name if n.endswith('.parquet'))}",
                )
            product = by_name[product]
        return pd.DataFrame(tables.read_table(self.processed / product.file, product))

    def _load(self, kind: type[tables.Loaded]) -> tables.Loaded:
        return tables.load(self.processed / kind.file, kind)

    def _open(
        self, executor: str, keep: bool = True
    ) -> contextlib.AbstractContextManager[engine.Job]:
        from nearlift.run.workers import open_campaign

        return open_campaign(self.root, self.out, STAGES, executor, self.seed, keep=keep)

    def _steps(self, last: str) -> tuple[list[engine.Step], AboutRun]:
        """Run what is stale up to and including the stage `last`: its steps, and what every answer
        says of them.
        """
        wanted = STAGES[: ORDER.index(last) + 1]
        with self._open(self.executor) as job:
            steps = list(engine.run(job, wanted))
        rejected = tuple(r for step in steps for r in step.outcome.rejected)
        notes = tuple(dict.fromkeys(note for step in steps for note in step.outcome.notes))
        return steps, {"campaign": self.name, "rejected": rejected, "notes": notes}

    def __repr__(self) -> str:
        return f"Study({self.name!r}, {str(self.root)!r}, out={str(self.out)!r})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(stage)}</td><td>{escape(why or 'up to date')}</td></tr>"
            for stage, why in self.plan().items()
        )
        return (
            f"<table><caption>{escape(self.name)}</caption>"
            f"<thead><tr><th>stage</th><th>state</th></tr></thead><tbody>{rows}</tbody></table>"
        )


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
        Of everything random.
    executor : str
        ``serial``, ``threads:N``, ``processes:N`` or ``dask:ADDRESS``.

    Raises
    ------
    ManifestError
        ``campaign.toml`` is missing or breaks the contract; every fault is listed.
    """
    return Study(Path(campaign), Path(out), seed, executor)
