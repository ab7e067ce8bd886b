"""Stage report: every figure as .pdf, .png and .csv, documents for papers, and index.html."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nearlift.run.engine import Job, Outcome, Stage

if TYPE_CHECKING:
    from concurrent.futures import Future

    import pandas as pd

    from nearlift.report.evidence import Evidence
    from nearlift.report.figures.spec import FigureSpec


def run(job: Job) -> Outcome:
    """Make the whole report again; remove the files of a figure whose products are missing."""
    from nearlift.report import charts
    from nearlift.report.figures.files import render
    from nearlift.report.page.render import Picture, page
    from nearlift.report.registry import FIGURES
    from nearlift.report.tables import csv
    from nearlift.run.workers import Processes
    from nearlift.stages.gathering import gather

    evidence = gather(job)
    # processes that have read draw every second figure: matplotlib needs one for itself
    others = job.executor if isinstance(job.executor, Processes) and job.executor.ready else None
    drawing: list[tuple[FigureSpec, pd.DataFrame, Future[dict[str, bytes]] | None]] = []
    missing: list[str] = []
    for i, spec in enumerate(FIGURES):
        job.say(f"report {spec.name}", i / len(FIGURES))
        rows = spec.table(evidence)
        if rows.empty:
            missing += [spec.name] if _expected(job, spec) else []
            for kind in ("pdf", "png", "csv"):
                job.put(f"reports/{spec.name}.{kind}", None)
            continue
        job.put(f"reports/{spec.name}.csv", csv(rows))
        future = None
        if others and len(drawing) % 2 == 0:
            future = others.submit(render, spec.draw, rows, job.campaign.simulated)
        drawing.append((spec, rows, future))
    _documents(job, evidence)
    chart = charts.fig2(evidence) if any(spec.name == "fig2" for spec, *_ in drawing) else None
    drawn = {
        spec.name: render(spec.draw, rows, job.campaign.simulated)
        for spec, rows, future in drawing
        if not future
    }
    drawn |= {spec.name: future.result() for spec, _, future in drawing if future}
    pictures: list[Picture] = []
    for spec, rows, _ in drawing:
        files = drawn[spec.name]
        for kind, content in files.items():
            job.put(f"reports/{spec.name}.{kind}", content)
        picture = Picture(
            name=spec.name,
            title=spec.title,
            caption=spec.captioned(evidence, rows),
            alt=spec.alt(rows),
            png=files["png"],
        )
        pictures.append(picture)
    job.put("reports/index.html", page(evidence, pictures, chart=chart))
    return Outcome(
        notes=tuple(f"{name} was not drawn: its products are missing or empty" for name in missing)
    )


def _documents(job: Job, evidence: Evidence) -> None:
    """Texts and tables."""
    from nearlift.report import tables
    from nearlift.report.documents import methods, summary

    for name, make in tables.TABLES.items():
        table = make(evidence)
        about = f"{job.campaign.name}: {table.caption}"
        job.put(f"reports/tables/{name}.tex", tables.latex(table, about).encode())
        job.put(f"reports/tables/{name}.csv", tables.csv(table.frame))
    for name, written in (
        ("summary.txt", summary.summary),
        ("methods.md", methods.markdown),
        ("references.bib", methods.references),
    ):
        job.put(f"reports/{name}", written(evidence))


def _expected(job: Job, spec: FigureSpec) -> bool:
    """Whether the campaign asks for every stage that makes what a figure shows."""
    from nearlift.stages import STAGES

    return all(
        stage.configured(job.campaign)
        for stage in STAGES
        if not set(stage.writes).isdisjoint(spec.needs)
    )


STAGE = Stage(
    name="report",
    run=run,
    imports=("nearlift.report.registry",),
    summary="draw figures, write tables and the page",
    sections=(
        "name",
        "simulated",
        "note",
        "vehicle",
        "rig",
        "load_cell",
        "trials",
        "levels",
        "fit",
        "uncertainty",
        "piv",
    ),
    report=True,
)
