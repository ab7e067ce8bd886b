"""Command line: a function for each command, which imports what it needs when it is called."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from nearlift.blas import default_to_one_thread

# before numpy is first imported
default_to_one_thread()
# looking for pydantic's plug-ins takes longer than checking a manifest
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

from nearlift import terminal  # noqa: E402
from nearlift.errors import ProductError, UsageError, brief  # noqa: E402
from nearlift.planning.question import ROUNDS, VisitQuestion  # noqa: E402
from nearlift.printing import say  # noqa: E402
from nearlift.run.engine import MANIFEST, Stage  # noqa: E402
from nearlift.stages import ORDER, STAGES  # noqa: E402
from nearlift.terminal import HEADINGS, Call, Command, Commands  # noqa: E402
from nearlift.version import __version__  # noqa: E402

BEGIN, RUN, SINGLE, AFTERWARDS, LOOK_UP = HEADINGS
ABOUT = """Lift of a tethered rotorcraft near ground, ceiling and wall.

nearlift averages load-cell records and fits a model of lift against distance. It looks for the
cause of the residuals, and quotes one coefficient with its uncertainty and its doubts.

\b
First look:    nearlift demo
Own records:   nearlift new raw/my-rig --from logs/*.csv
               nearlift run raw/my-rig
Then open reports/my-rig/index.html, or read summary.txt next to it.

Exit codes: 0 done; 2 usage or manifest; 3 done, some trials rejected; 4 input unreadable or
refused; 5 a fit did not converge; 130 interrupted.
"""
PATH = click.Path(path_type=Path)


class CampaignFolder(click.Path):
    """Folder of a campaign, for which its manifest may be given."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Folder as a path."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        return path.parent if path.name == MANIFEST and path.is_file() else path


CAMPAIGN = CampaignFolder(path_type=Path)
POSITIVE = click.FloatRange(min=0, min_open=True)
flag = functools.partial(click.option, is_flag=True)
campaign_argument = click.argument("campaign", type=CAMPAIGN)
dialect_option = click.option(
    "--dialect",
    default="",
    metavar="KEYS",
    help="How to read the text, as [records] dialect in a manifest: 'separator = \"semicolon\"'.",
)
registry_option = click.option(
    "--registry", type=PATH, metavar="FILE", help="Your list of data sets, in the form of ours."
)


@click.group(
    cls=Commands,
    help=ABOUT,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 110,
        "show_default": True,
    },
)
@click.version_option(__version__, prog_name="nearlift")
def main() -> None:
    """Run the command line."""


# ---- begin


@main.command(heading=BEGIN, example="demo")
def demo(call: Call) -> None:
    """Run a simulated campaign, end to end.

    It is written to demo-campaign/ and run; it needs nothing but the package.
    """
    from nearlift.synthetic.demo import write_demo

    folder = call.out / "demo-campaign"
    with call.busy("nearlift: simulating the demo's records"):
        write_demo(folder)
    call.line(f"simulated campaign in {folder}")
    terminal.execute(call, folder)


@main.command(heading=BEGIN, example="new raw/my-rig\nnew raw/my-rig --from logs/*.csv")
@click.argument("folder", type=PATH, metavar="DIR")
@click.argument("files", nargs=-1, type=PATH)
@flag("--from", help="Build the campaign from FILES: records and their list, or a table of means.")
@dialect_option
def new(call: Call, folder: Path, files: tuple[Path, ...], dialect: str, **given: bool) -> None:
    """Make a campaign folder, empty or from records.

    With --from FILES, the folder of a campaign whose records are FILES: those in the folder stay,
    others are copied into it. What no file says is marked FILL IN.
    """
    from nearlift.onboarding.new import write_from, write_template

    if given["from"] != bool(files):
        what = "names no files" if given["from"] else "is missing before the files"
        raise UsageError("--from", what, "nearlift new DIR --from FILES")
    made = write_from(folder, files, dialect_of(dialect)) if files else write_template(folder)
    copied = [path for path in made.written if path.parent != folder]
    lines = [str(path) for path in made.written if path.parent == folder]
    if copied:
        lines.append(f"{copied[0].parent}: {len(copied)} file{'s' * (len(copied) > 1)}")
    lines += [f"note: {note}" for note in made.notes]
    lines += ["still to fill in:", *(f"  {item}" for item in made.fill_in)]
    lines.append(f"then: nearlift run {shlex.quote(str(folder))}")
    written = [str(path) for path in made.written]
    content = {"written": written, "fill_in": made.fill_in, "notes": made.notes}
    call.answer(content, "\n".join(lines))


@main.command(heading=BEGIN, example="inspect logs/run-1.csv\ninspect --cuts raw/my-rig")
@click.argument("files", type=PATH, nargs=-1, required=True, metavar="FILE...")
@dialect_option
@flag("--cuts", help="Instead: cut a campaign's records by its [segments], and draw segments.png.")
def inspect(call: Call, files: tuple[Path, ...], dialect: str, cuts: bool) -> None:
    """Show what a file holds, and the lines that read it.

    Lists its channels and prints the tables of a manifest that read it. These are [records] of a
    record, [piv] of a velocity grid, or the schedule's units of a table of means. With --cuts, FILE
    is a campaign's folder.
    """
    if cuts and dialect:
        remedy = "write it under [records] of the manifest"
        raise UsageError("--dialect", "was given with --cuts", remedy)
    if cuts:
        from nearlift.onboarding import cuts as cutting

        call.answers("campaigns", [cutting.cuts(campaign, call.out) for campaign in files])
        return
    from nearlift.onboarding import shown
    from nearlift.onboarding.inspection import inspect

    inspections = [inspect(file, dialect_of(dialect)) for file in files]
    call.answers("files", [(shown.as_json(one), shown.described(one)) for one in inspections])


def dialect_of(text: str) -> dict[str, object]:
    """Dialect of ``--dialect``, with or without its braces; `UsageError` if it is no TOML."""
    from nearlift.campaign import manifest as manifests
    from nearlift.errors import ManifestError

    table = text if text.strip().startswith("{") else f"{{ {text} }}"
    try:
        dialect: dict[str, object] = manifests.loads(f"dialect = {table}".encode(), "it")["dialect"]
    except ManifestError as fault:
        what = f"{brief(repr(text))} is not as a manifest has it: {fault.what}"
        remedy = """such as --dialect 'separator = "semicolon", decimal = ","'"""
        raise UsageError("--dialect", what, remedy) from None
    return dialect


@main.command(heading=BEGIN, example="design raw/my-rig --write raw/my-rig/planned.csv")
@campaign_argument
@click.option("--write", type=PATH, help="Where the random schedule goes; never over a file.")
def design(call: Call, campaign: Path, write: Path | None) -> None:
    """Plan a campaign: what it can detect, and a schedule.

    For CAMPAIGN before it is run: detectable effects, confounded effects, and a random schedule.
    The plan is the folder's schedule, or the manifest's [design].
    """
    from nearlift.report.forecasts import design as text
    from nearlift.results.document import as_json
    from nearlift.stages import forecasts

    with call.job(campaign, planned=True) as job, call.busy(f"nearlift: {job.campaign.name}"):
        answer = forecasts.design(job, write)
    call.answer(as_json(answer), text(answer))


@main.group(cls=Commands, epilog="\b\nFor example:\n  nearlift data list")
def data() -> None:
    """List and fetch public measured campaigns."""


@data.command("list", example="data list")
@registry_option
def list_data(call: Call, registry: Path | None) -> None:
    """List the data sets: quantities, licence, size."""
    from nearlift.datasets.registry import OWN, datasets

    listed = datasets(registry or OWN).values()
    call.answer([item.model_dump() for item in listed], "\n".join(map(str, listed)))


@data.command("get", example="data get pitt-ras-2017")
@click.argument("name")
@click.argument("folder", type=PATH, required=False, metavar="[DIR]")
@registry_option
def get_data(call: Call, name: str, folder: Path | None, registry: Path | None) -> None:
    """Fetch NAME and make it a campaign.

    It is made in DIR (default: raw/NAME). Fetched files are kept in NEARLIFT_CACHE, or where the
    system has caches, and not fetched again.
    """
    from nearlift.datasets.fetch import get
    from nearlift.datasets.registry import OWN, dataset

    chosen = dataset(name, registry or OWN)
    folder = folder or Path("raw") / name
    get(chosen, folder, call.line)
    then = f"{chosen.next} {folder}"
    content = {"campaign": str(folder), "licence": chosen.licence, "citation": chosen.citation}
    lines = (str(folder), f"licence: {chosen.licence}; cite: {chosen.citation}", f"next: {then}")
    call.answer(content | {"next": then}, "\n".join(lines))


# ---- run


@main.command(
    heading=RUN,
    example="run raw/my-rig\nrun raw/a raw/b --executor processes:2\nrun --dry-run raw/my-rig",
)
@click.argument("campaigns", type=CAMPAIGN, nargs=-1, required=True, metavar="CAMPAIGN...")
@click.option("--only", type=click.Choice(ORDER), help="Run this stage alone, stale or not.")
@flag("--dry-run", help="Run nothing; say which stages are stale, and why.")
@flag("--check", help="Run nothing; list files that differ from provenance.json, exit 4 if any.")
@flag("--watch", help="Run again whenever CAMPAIGN's folder has changed, until Ctrl-C.")
@click.option("--every", type=POSITIVE, default=5.0, metavar="S", help="--watch looks every S s.")
@click.option("--next", "question", help="With --watch: the next visits, as `nearlift next --for`.")
@click.option("--until", type=POSITIVE, metavar="U", help="With --next: stop when u is below U.")
def run(
    call: Call,
    campaigns: tuple[Path, ...],
    only: str | None,
    every: float,
    question: str | None,
    until: float | None,
    **modes: bool,
) -> None:
    """Run every stage that is not up to date.

    Of several campaigns, one after the other, or side by side with processes:N.
    """
    chosen = ["--only"] if only else []
    chosen += [f"--{name.replace('_', '-')}" for name, given in modes.items() if given]
    if len(chosen) > 1:
        raise UsageError(chosen[0], f"was given with {chosen[1]}", "choose one of them")
    instead = "`nearlift next` plans the visits of a finished campaign"
    if question and not modes["watch"]:
        raise UsageError("--next", "needs --watch", instead)
    if until is not None and not question:
        raise UsageError("--until", "needs --next", instead)
    if modes["dry_run"]:
        call.answers("campaigns", [_planned(call, campaign) for campaign in campaigns])
    elif modes["check"]:
        _check(call, campaigns)
    elif modes["watch"]:
        asked = VisitQuestion.parsed(question, until) if question else None
        _follow(call, campaigns, every, asked)
    elif len(campaigns) == 1:
        terminal.execute(call, campaigns[0], only)
    else:
        terminal.execute_many(call, campaigns, only)


def _planned(call: Call, campaign: Path) -> tuple[dict[str, Any], str]:
    """Stages with the reasons why they are stale, as JSON and as text."""
    from nearlift.run import engine

    with call.job(campaign) as job:
        steps = [(stage.name, why) for stage, why in engine.plan(job)]
    stages = [{"stage": name, "stale": bool(why), "why": why} for name, why in steps]
    lines = (f"{name:<8} {'run: ' + why if why else 'up to date'}" for name, why in steps)
    return {"campaign": job.campaign.name, "stages": stages}, "\n".join(lines)


def _check(call: Call, campaigns: tuple[Path, ...]) -> None:
    """List files that differ from provenance.json; exit with 4 if any does."""
    from nearlift.run.engine import differences

    answers = []
    for campaign in campaigns:
        with call.job(campaign, fresh=True) as job:
            checked, differing = differences(job)
        same = f"{checked - len(differing)} of {checked} files are what they were"
        content = {"campaign": job.campaign.name, "checked": checked, "differing": differing}
        answers.append((content, "\n".join([*differing, same])))
    call.answers("campaigns", answers)
    if any(content["differing"] for content, _ in answers):
        sys.exit(ProductError.exit_code)


def _follow(
    call: Call, campaigns: tuple[Path, ...], period_s: float, asked: VisitQuestion | None
) -> None:
    """Run a campaign that is being recorded until interrupted; with --json, one object a round."""
    from nearlift.run.watch import watch
    from nearlift.stages import looks

    if len(campaigns) > 1:
        remedy = "watch one; run the others in terminals of their own"
        raise UsageError("--watch", f"was given {len(campaigns)} campaigns", remedy)
    call.line(f"watching {campaigns[0]} every {period_s:g} s; Ctrl-C ends it")
    look = functools.partial(looks.look, asked)
    given = (campaigns[0], call.out, STAGES, call.executor, call.seed, look, period_s)
    for latest in watch(*given, call.progress):
        for line in (latest.words, *latest.next):
            call.line(line)
        if call.as_json:
            say(json.dumps(asdict(latest)))


@main.command("next", heading=RUN, example="next raw/my-rig --for K_b --until 0.05")
@campaign_argument
@click.option(
    "--for",
    "question",
    required=True,
    help="A coefficient, such as K_b; separate=A,B for two effects, separate alone for those that"
    " the diagnosis could not distinguish.",
)
@click.option("--until", type=POSITIVE, metavar="U", help="Count the trials that bring u to U.")
@click.option("--count", type=click.IntRange(1, 1000), default=10, help="Visits at each boundary.")
@click.option(
    "--rounds", type=click.FloatRange(0, 1), default=ROUNDS, help="Share of all stations."
)
@flag("--csv", help="Rows for the campaign's schedule instead.")
def next_visits(
    call: Call,
    campaign: Path,
    question: str,
    until: float | None,
    count: int,
    rounds: float,
    csv: bool,
) -> None:
    """Propose the next visits.

    For a coefficient, or to distinguish two effects. They are chosen from the campaign's trials,
    with a share at all stations. Prints their gain, and where to stop. Stages ingest
    and, for identified effects, diagnose must have run. Nothing is written.
    """
    from nearlift.report import visits
    from nearlift.results.document import as_json
    from nearlift.stages import forecasts

    asked = VisitQuestion.parsed(question, until, rounds)
    if csv and call.as_json:
        raise UsageError("--csv", "was asked for with --json", "choose one of them")
    with call.job(campaign) as job, call.busy(f"nearlift: {job.campaign.name}"):
        batches, elsewhere = forecasts.next_visits(job, asked, count)
        rows = forecasts.next_rows(job, batches) if csv else ""
    boundaries = {b.boundary: as_json(b) | {"text": visits.lines(b)} for b in batches}
    call.answer(
        {"campaign": job.campaign.name, "boundaries": boundaries, "notes": elsewhere},
        rows or "\n\n".join([*map(visits.text, batches), *elsewhere]),
    )


@main.command(heading=RUN, example="serve\nserve ~/lift --port 8765")
@click.argument("folder", type=PATH, default=Path(), metavar="[WORKSPACE]")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port; 0: any free one.")
def serve(call: Call, folder: Path, port: int) -> None:
    """Show campaigns and reports in a browser, live.

    A read-only page for this machine alone, behind a link that is good once. WORKSPACE (default:
    the current folder) holds processed/ and reports/. `nearlift run --watch` brings the page up to
    date while a campaign is recorded.
    """
    if not folder.is_dir():
        raise UsageError(str(folder), "is no folder", "name the folder that holds processed/")
    from nearlift.serve.pages import respond
    from nearlift.serve.server import Server

    # Ctrl-C is the way to end: it may come as soon as the link is read
    answer = functools.partial(respond, folder)
    with contextlib.suppress(KeyboardInterrupt), Server(port, answer) as server:
        call.answer(
            {"workspace": str(folder.resolve()), "link": server.link},
            f"{folder.resolve()}: open {server.link}\n"
            "the link is good for one browser; Ctrl-C ends the page",
        )
        server.serve_forever()


# ---- single stages


def _explain(call: Call, campaign: Path, given: Mapping[str, object]) -> None:
    """Describe an effect, its detectable size in this campaign, and what is confounded with it."""
    from nearlift.report.forecasts import effect as text
    from nearlift.results.document import as_json
    from nearlift.stages import forecasts

    name = str(given["explain"])
    with call.job(campaign) as job, call.busy(f"nearlift: {name}"):
        explanation = forecasts.explain(job, name)
    call.answer(as_json(explanation), text(explanation))


def _read_distance(call: Call, campaign: Path, given: Mapping[str, object]) -> None:
    """Distance of the boundary by one reading; quantities are texts, as in the manifest."""
    from nearlift.campaign.choices import LiftReading
    from nearlift.campaign.manifest import validated
    from nearlift.flight.proximity import read
    from nearlift.results.document import as_json
    from nearlift.stages.diagnose import quoted_lifts

    for name, example, why in (
        ("boundary", "ground", "a reading is one of ground, ceiling or sidewall"),
        ("u", "'1 percent'", "a reading has a standard uncertainty"),
    ):
        if name not in given:
            raise UsageError(f"--{name}", f"is missing: {why}", f"add --{name} {example}")
    fields = {name.removesuffix("_u"): value for name, value in given.items()}
    reading = validated(LiftReading, fields, "nearlift detect")
    with call.job(campaign) as job:
        result = read(quoted_lifts(job), reading)
    call.answer(as_json(result), result.text)


#: Answers to the questions of stages, by stage.
QUESTIONS = {"diagnose": _explain, "detect": _read_distance}


def stage_command(stage: Stage) -> Command:
    """Command that runs this stage, stale or not, or answers its question."""

    def run_stage(call: Call, campaign: Path, **given: object) -> None:
        asked = {name: value for name, value in given.items() if value is not None}
        if asked:
            QUESTIONS[stage.name](call, campaign, asked)
        else:
            terminal.execute(call, campaign, stage.name)

    written = ", ".join(product.file for product in stage.writes)
    text = (f"Writes {written}." if written else "", stage.help, "Earlier stages must have run.")
    example = f"{stage.name} raw/my-rig"
    return Command(
        stage.name,
        callback=run_stage,
        params=[click.Argument(["campaign"], type=CAMPAIGN), *stage.question],
        help=f"{stage.summary[0].upper()}{stage.summary[1:]}.\n\n{' '.join(filter(None, text))}",
        heading=SINGLE,
        example=example + (f"\n{example} {stage.example}" if stage.example else ""),
    )


for _stage in STAGES:
    main.add_command(stage_command(_stage))


# ---- afterwards


@main.command(heading=AFTERWARDS, example="explain raw/my-rig supply_sag")
@campaign_argument
@click.argument("effect")
def explain(call: Call, campaign: Path, effect: str) -> None:
    """Show what this campaign can say about one effect.

    The effect, its detectable size in this campaign, and the effects confounded with it. Stage
    ingest must have run. `diagnose --explain` is the same.
    """
    _explain(call, campaign, {"explain": effect})


@main.command(heading=AFTERWARDS, example="compare rig-a rig-b")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--shared", multiple=True, help="An [[uncertainty]] that all campaigns share.")
def compare(call: Call, names: tuple[str, ...], shared: tuple[str, ...]) -> None:
    """Compare one coefficient over several campaigns.

    Table, forest plot and population mean over finished campaigns; without names, all. The mean
    does not average down shared errors.
    """
    from nearlift import comparison
    from nearlift.results.document import as_json

    compared = comparison.run(call.out, names, shared)
    plot = call.out / "reports" / comparison.FOLDER / "forest.pdf"
    call.answer(as_json(compared), "\n".join([*comparison.table(compared), str(plot)]))


@main.command(heading=AFTERWARDS, example="export raw/my-rig --c --netcdf")
@campaign_argument
@flag("--netcdf", help="posterior.nc: draws of every model, for ArviZ and xarray.")
@flag("--c", help="export/lift_model.h: a C99 header for firmware, metres in.")
@flag("--document", help="export/lift_model.json, and its JSON Schema.")
@flag("--python", help="export/lift_model.py: a module that needs only Python.")
def export(call: Call, campaign: Path, **formats: bool) -> None:
    """Write the fitted model for other programs: C, Python, JSON.

    Stage fit must have run.
    """
    from nearlift.stages.export import export

    chosen = tuple(name for name, asked in formats.items() if asked)
    if not chosen:
        remedy = f"add {', '.join(f'--{name}' for name in formats)}"
        raise UsageError("export", "no format was asked for", remedy)
    with call.job(campaign) as job:
        written = export(job, chosen)
    call.answer({"campaign": job.campaign.name, "written": written}, "\n".join(written))


# ---- look up


@main.command(heading=LOOK_UP, example="describe\ndescribe sanchez_cuevas")
@click.argument("name", required=False)
def describe(call: Call, name: str | None) -> None:
    """Look up a model, effect, product or symbol."""
    from nearlift.describe import describe

    text = describe(name)
    call.answer({"name": name, "text": text}, text)
