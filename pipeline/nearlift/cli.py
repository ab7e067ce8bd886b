"""The command line: arguments to stages. A stage, and what it imports, is loaded only when it is
asked for.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

# small fits are slowed down many times by BLAS threads that wait for each other; set before numpy
# is first imported
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# what a manifest means is for nearlift to say, and to look for packages that would have a say takes
# longer than to check it
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

from nearlift import __version__  # noqa: E402
from nearlift.errors import INTERRUPTED, SOME_TRIALS_REJECTED, NearliftError, UsageError  # noqa: E402
from nearlift.run.workspace import spare_raw, workspace  # noqa: E402

if TYPE_CHECKING:
    from nearlift.run.graph import Stage
    from nearlift.run.job import Job

STAGE_NAMES = {
    "ingest": "Raw records to one row per trial (trials.parquet).",
    "reduce": "Trials to Delta L per cell with its covariance (lift.parquet).",
    "fit": "Lift models by least squares and as posteriors (fit.json, posterior.parquet).",
    "diagnose": "The residual traced to a named effect, or not (diagnosis.json).",
    "flow": "Velocity grids to downwash and topology (downwash.parquet), where [piv] lists any.",
    "joint": (
        "Base models fitted to lift and downwash together, where [fit.<boundary>] downwash = true"
        " (joint.json)."
    ),
    "simulate": (
        "Flights near ground and ceiling: crash rates, energy, what they mean (crash_rates.parquet,"
        " safety.json)."
    ),
    "detect": (
        "How far away a boundary shows in lift, and where it is (detection.parquet,"
        " proximity.json)."
    ),
    "ledger": (
        "Every trial from raw byte to figure, and what its exclusion is worth (quality.json)."
    ),
    "report": "Figures, tables and index.html.",
}


def common(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that every command takes."""
    options = (
        click.option(
            "--out",
            type=click.Path(path_type=Path, file_okay=False),
            show_default="the current folder, within raw/ the one that holds it",
            help="Folder that holds processed/ and reports/.",
        ),
        click.option(
            "--executor",
            default="threads:2",
            show_default=True,
            help="serial, threads:N, processes:N or dask:ADDRESS.",
        ),
        click.option(
            "--seed", type=int, default=0, show_default=True, help="Seed of everything random."
        ),
        click.option(
            "--json", "as_json", is_flag=True, help="One JSON object on stdout instead of text."
        ),
        click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors."),
        click.option("-v", "--verbose", is_flag=True, help="Say more."),
    )
    for option in reversed(options):
        command = option(command)

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        def end(refusal: NearliftError, code: int, told: str) -> NoReturn:
            if kwargs.get("as_json"):
                click.echo(
                    json.dumps(
                        {
                            "exit_code": code,
                            "where": refusal.where,
                            "what": refusal.what,
                            "remedy": refusal.remedy,
                        }
                    )
                )
            click.echo(told, err=True)
            sys.exit(code)

        try:
            if kwargs["out"] is None:
                kwargs["out"] = workspace(
                    kwargs["campaigns"]
                    if "campaigns" in kwargs
                    else [kwargs["campaign"]]
                    if "campaign" in kwargs
                    else []
                )
            command(*args, **kwargs)
        except NearliftError as refusal:
            end(refusal, refusal.exit_code, f"error: {refusal}")
        except (KeyboardInterrupt, click.Abort):
            stopped = NearliftError(
                "nearlift",
                "interrupted",
                "finished products stand, and the same command goes on from there",
            )
            end(stopped, INTERRUPTED, f"{stopped.what}; {stopped.remedy}")
        except BrokenPipeError:
            raise
        except OSError as fault:
            what, remedy = (
                (fault.strerror or str(fault)).lower(),
                "check that it exists, who may read and write it, and the space on the disk",
            )
            failed = NearliftError(str(fault.filename or "nearlift"), what, remedy)
            end(failed, failed.exit_code, f"error: {failed}")

    return guarded


class Voice:
    """What the user hears: progress on a terminal, plain lines elsewhere, nothing when quiet."""

    def __init__(self, quiet: bool, verbose: bool, as_json: bool) -> None:
        self.quiet, self.verbose, self.as_json = quiet or as_json, verbose, as_json
        self.status: Any = None

    def line(self, text: str) -> None:
        """One line for the user."""
        if not self.quiet:
            click.echo(text, err=True)

    def progress(self, text: str) -> None:
        """A passing remark: shown on a terminal, kept only with -v."""
        if self.status is not None:
            self.status.update(text)
        elif self.verbose:
            self.line(f"  {text}")

    @contextlib.contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show that something is going on, on a terminal only."""
        if self.quiet or not sys.stderr.isatty():
            yield
            return
        from rich.console import Console

        with Console(stderr=True).status(text) as self.status:
            yield
        self.status = None


@contextlib.contextmanager
def no_garbage() -> Iterator[None]:
    """While modules are imported, which stay: nobody looks for garbage among them, now or later,
    which would take a tenth of the time.
    """
    gc.disable()
    try:
        yield
    finally:
        _freeze()
        gc.enable()


@functools.cache
def _freeze() -> None:
    """Once: what is garbage by a later command in the same process would never be found."""
    gc.freeze()


@contextlib.contextmanager
def open_job(
    campaign: Path, out: Path, executor: str, seed: int, voice: Voice, keep: bool = True
) -> Iterator[Job]:
    """The campaign as a job that speaks with this voice."""
    from nearlift.run import opening

    with opening.open_job(campaign, out, executor, seed, voice.progress, keep, voice.line) as job:
        yield job


@contextlib.contextmanager
def open_plan(campaign: Path, out: Path, seed: int, voice: Voice) -> Iterator[Job]:
    """The campaign as a job that has no records yet: the manifest is checked, no input is looked
    for.
    """
    from nearlift.manifest import campaign as manifests
    from nearlift.run.executors import open_executor
    from nearlift.run.job import Job

    loaded = manifests.load(campaign)
    spare_raw(campaign, out)
    processed, reports = out / "processed" / loaded.name, out / "reports" / loaded.name
    with open_executor("serial") as pool:
        yield Job(
            root=campaign,
            campaign=loaded,
            processed=processed,
            reports=reports,
            executor=pool,
            seed=seed,
            say=voice.progress,
        )


def _end_politely() -> None:
    """A batch system's polite end is an interrupt as well."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def execute(
    campaign: Path,
    stages: tuple[str, ...] | None,
    out: Path,
    executor: str,
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: bool,
    force: bool = False,
    overrides: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Run stages on a campaign and end with the contract's exit code; `overrides` of the manifest
    by section.
    """
    with no_garbage():
        from nearlift.run import graph, opening  # noqa: F401 - what opens the campaign
        from nearlift.run.lock import size

    _end_politely()
    voice = Voice(quiet, verbose, as_json)
    told: list[dict[str, Any]] = []
    rejected: list[tuple[str, str]] = []
    with open_job(campaign, out, executor, seed, voice) as job:
        for section, given in (overrides or {}).items():
            job = job.overriding(section, given)
        wanted = graph.STAGES if stages is None else tuple(map(graph.stage, stages))

        def begin(item: Stage, why: str) -> None:
            # what is to be read is told before it is read
            held = (
                f"; {len(job.stamps)} files with"
                f" {size(sum(s['stamp'][0] for s in job.stamps.values()))}"
                if item.name == "ingest"
                else ""
            )
            voice.line(f"{item.name:<9}{item.summary} ({why}{held})")

        steps = graph.run(job, wanted, begin=begin, force=force)
        with voice.busy(f"nearlift: {job.campaign.name}"):
            for step in steps:
                if not step.why:
                    voice.line(f"{step.stage.name:<9}up to date")
                for note in step.outcome.notes:
                    voice.line(f"  note: {note}")
                rejected += step.outcome.rejected
                told.append(
                    {
                        "stage": step.stage.name,
                        "why": step.why,
                        "notes": step.outcome.notes,
                        "rejected": step.outcome.rejected,
                        "wall_s": step.wall_s,
                    }
                )
        report = job.reports / "index.html"
    code = SOME_TRIALS_REJECTED if rejected else 0
    if rejected:
        voice.line(f"{len(rejected)} trial{'s' * (len(rejected) > 1)} rejected:")
        for trial, reason in rejected if verbose else rejected[:10]:
            voice.line(f"  {trial}: {reason}")
        if len(rejected) > 10 and not verbose:
            voice.line(f"  ... and {len(rejected) - 10} more (-v lists all)")
    if as_json:
        click.echo(
            json.dumps(
                {
                    "campaign": job.campaign.name,
                    "exit_code": code,
                    "report": str(report) if report.is_file() else None,
                    "stages": told,
                }
            )
        )
    elif report.is_file() and not quiet and wanted[-1].report:
        click.echo(str(report))
    sys.exit(code)


def execute_many(
    campaigns: tuple[Path, ...],
    out: Path,
    executor: str,
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Run several campaigns; one that is refused does not stop the others. Ends with the gravest
    exit code.
    """
    from nearlift.run import many

    voice = Voice(quiet, verbose, as_json)
    ended = []
    with voice.busy(f"nearlift: {len(campaigns)} campaigns"):
        for end in many.run(campaigns, out, executor, seed):
            voice.line(f"{end.campaign:<24}{end.words}")
            ended.append(end)
    if as_json:
        click.echo(json.dumps({"campaigns": [end.told() for end in ended]}))
    sys.exit(many.gravest(ended))


def follow(
    campaign: Path,
    period_s: float,
    out: Path,
    executor: str,
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Run a campaign that is being recorded, again and again, until it is interrupted; with
    `as_json` one object a round.
    """
    from dataclasses import asdict

    from nearlift.run.watch import watch

    _end_politely()
    voice = Voice(quiet, verbose, as_json)
    voice.line(f"watching {campaign} every {period_s:g} s; Ctrl-C ends it")
    for found in watch(campaign, out, executor, seed, period_s, voice.progress):
        voice.line(found.words)
        if as_json:
            click.echo(json.dumps(asdict(found)))


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="nearlift")
def main() -> None:
    """Near-boundary lift of tethered rotorcraft: from load-cell records to models with honest
    uncertainty.

    Exit codes: 0 done; 2 usage or manifest; 3 done, some trials rejected; 4 input unreadable or
    refused; 5 a fit did not converge; 130 interrupted.
    """


CAMPAIGN = click.argument("campaign", type=click.Path(path_type=Path))


@main.command()
@click.argument(
    "campaigns", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="CAMPAIGN..."
)
@click.option(
    "--watch",
    is_flag=True,
    help="Go on: run again whenever CAMPAIGN's folder has changed, until Ctrl-C.",
)
@click.option(
    "--every",
    type=click.FloatRange(min=0.1),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="How often --watch looks.",
)
@common
def run(campaigns: tuple[Path, ...], watch: bool, every: float, **options: Any) -> None:
    """Every stage of CAMPAIGN that is stale; of several campaigns, one after the other, or side by
    side with processes:N.
    """
    if watch:
        if len(campaigns) > 1:
            raise UsageError(
                "--watch",
                f"was given {len(campaigns)} campaigns",
                "watch one; run the others in terminals of their own",
            )
        follow(campaigns[0], every, **options)
    elif len(campaigns) == 1:
        execute(campaigns[0], None, **options)
    else:
        execute_many(campaigns, **options)


@main.command()
@common
def demo(out: Path, **options: Any) -> None:
    """The embedded, simulated campaign, end to end; needs nothing but the package."""
    from nearlift.synthetic.demo import write_demo

    folder = out / "demo-campaign"
    voice = Voice(options["quiet"], options["verbose"], options["as_json"])
    with voice.busy("nearlift: simulating the demo's records"):
        write_demo(folder)
    voice.line(f"simulated campaign in {folder}")
    execute(folder, None, out, **options)


def _stage_command(name: str, summary: str) -> None:
    @main.command(
        name, help=summary + " Runs even if it is up to date; earlier stages must have run."
    )
    @CAMPAIGN
    @common
    def command(campaign: Path, **options: Any) -> None:
        execute(campaign, (name,), force=True, **options)


for _name, _summary in STAGE_NAMES.items():
    if _name not in ("fit", "diagnose", "detect"):
        _stage_command(_name, _summary)


@main.command(
    help=STAGE_NAMES["fit"] + " Runs even if it is up to date; earlier stages must have run."
)
@CAMPAIGN
@click.option(
    "--sampler",
    type=click.Choice(("auto", "emcee", "importance")),
    help="Instead of the manifest's [fit] sampler, this once.",
)
@click.option(
    "--ess",
    type=click.IntRange(100, 1_000_000),
    help="Effective draws, instead of the manifest's [fit] ess, this once.",
)
@common
def fit(campaign: Path, sampler: str | None, ess: int | None, **options: Any) -> None:
    """The stage; what was put in place of the manifest stands in provenance.json, and `run` goes by
    the manifest again.
    """
    execute(
        campaign,
        ("fit",),
        force=True,
        overrides={"fit": {"sampler": sampler, "ess": ess}},
        **options,
    )


@main.command(
    help=STAGE_NAMES["diagnose"] + " Runs even if it is up to date; earlier stages must have run."
)
@CAMPAIGN
@click.option(
    "--explain",
    metavar="NAME",
    help=(
        "Instead: one effect, what it is, what this campaign could see of it, and what it is"
        " confused with."
    ),
)
@common
def diagnose(campaign: Path, explain: str | None, **options: Any) -> None:
    """The stage, or one effect explained."""
    if explain is None:
        execute(campaign, ("diagnose",), force=True, **options)
        return
    from nearlift.report.figures.explain import text
    from nearlift.run.store import plain
    from nearlift.stages import explain as explaining

    voice = Voice(options["quiet"], options["verbose"], options["as_json"])
    with (
        open_job(campaign, options["out"], "serial", options["seed"], voice) as job,
        voice.busy(f"nearlift: {explain}"),
    ):
        found = explaining.run(job, explain)
    if options["as_json"]:
        click.echo(json.dumps(plain(found)))
    elif not options["quiet"]:
        click.echo(text(found), nl=False)


def _reading(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that make a reading; each is text, as the manifest has it."""
    options = (
        click.option(
            "--boundary",
            type=click.Choice(["ground", "ceiling", "sidewall"]),
            help="Instead of the stage: where is it, by this reading?",
        ),
        click.option("--ratio", type=float, help="Lift over lift far away."),
        click.option("--throttle", help='Throttle at which the vehicle hovers, e.g. "55 percent".'),
        click.option(
            "--u", help='Standard uncertainty of the ratio or the throttle, e.g. "1 percent".'
        ),
        click.option("--weight-u", help="Relative standard uncertainty of the weight."),
        click.option("--supply-u", help="Relative standard uncertainty of the supply voltage."),
        click.option("--mass", help='Mass with payload, e.g. "29 g"; the vehicle\'s if not given.'),
    )
    for option in reversed(options):
        command = option(command)
    return command


@main.command(
    help=STAGE_NAMES["detect"] + " Runs even if it is up to date; earlier stages must have run."
)
@CAMPAIGN
@_reading
@common
def detect(
    campaign: Path,
    boundary: str | None,
    ratio: float | None,
    throttle: str | None,
    u: str | None,
    weight_u: str | None,
    supply_u: str | None,
    mass: str | None,
    **options: Any,
) -> None:
    """The stage, or one reading as a distance."""
    given = {
        "ratio": ratio,
        "throttle": throttle,
        "u": u,
        "weight": weight_u,
        "supply": supply_u,
        "mass": mass,
    }
    told = {name: value for name, value in given.items() if value is not None}
    if boundary is None:
        if told:
            raise UsageError(
                "--boundary",
                "is missing: a reading is one of ground, ceiling or sidewall",
                "add --boundary ground",
            )
        execute(campaign, ("detect",), force=True, **options)
        return
    from nearlift.flight.record import encode
    from nearlift.manifest.flight import Reading
    from nearlift.manifest.validation import validated
    from nearlift.run.store import plain
    from nearlift.stages.detect import read

    reading = validated(Reading, {"boundary": boundary, **told}, "nearlift detect")
    voice = Voice(options["quiet"], options["verbose"], options["as_json"])
    with open_job(campaign, options["out"], "serial", options["seed"], voice, keep=False) as job:
        found = read(job, reading)
    if options["as_json"]:
        click.echo(json.dumps(plain(encode(found))))
    elif not options["quiet"]:
        click.echo(found.text)


@main.command()
@CAMPAIGN
@click.option(
    "--noise-from",
    metavar="NAME",
    help="An earlier campaign under processed/ whose noise floor is expected.",
)
@click.option(
    "--write",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="Where the random schedule goes; never over a file.",
)
@common
def design(campaign: Path, noise_from: str | None, write: Path | None, **options: Any) -> None:
    """Before CAMPAIGN is run: what its plan could see, what it would confuse, what to change; draws
    a random schedule.

    The plan is the folder's schedule, or the manifest's [design].
    """
    from nearlift.report.figures.design import text
    from nearlift.run.lock import settled
    from nearlift.run.store import plain
    from nearlift.run.transaction import Homes
    from nearlift.stages import design as designing

    out: Path = options["out"]
    if noise_from is not None:
        settled(Homes.of(out, noise_from))
    voice = Voice(options["quiet"], options["verbose"], options["as_json"])
    with (
        open_plan(campaign, out, options["seed"], voice) as job,
        voice.busy(f"nearlift: {job.campaign.name}"),
    ):
        found = designing.run(
            job, earlier=None if noise_from is None else out / "processed" / noise_from, write=write
        )
    if options["as_json"]:
        click.echo(json.dumps(plain(found)))
    elif not options["quiet"]:
        click.echo(text(found), nl=False)


@main.command()
@CAMPAIGN
@common
def plan(
    campaign: Path, out: Path, executor: str, seed: int, as_json: bool, quiet: bool, verbose: bool
) -> None:
    """What is stale and why; runs nothing."""
    with no_garbage():
        from nearlift.run import graph, opening  # noqa: F401 - what opens the campaign

    with open_job(campaign, out, "serial", seed, Voice(quiet, verbose, as_json), keep=False) as job:
        steps = [(s.name, why) for s, why in graph.plan(job)]
    if as_json:
        click.echo(
            json.dumps(
                {
                    "campaign": job.campaign.name,
                    "stages": [{"stage": n, "stale": bool(w), "why": w} for n, w in steps],
                }
            )
        )
    else:
        for name, why in steps:
            click.echo(f"{name:<9}{'run: ' + why if why else 'up to date'}")


@main.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "--shared",
    multiple=True,
    metavar="COMPONENT",
    help="An [[uncertainty]] that is one and the same error in all campaigns.",
)
@common
def compare(
    names: tuple[str, ...], shared: tuple[str, ...], out: Path, as_json: bool, quiet: bool, **_: Any
) -> None:
    """One coefficient over many finished campaigns: table, forest plot, population mean
    and spread.
    """
    from nearlift.stages import compare as comparison

    content = comparison.run(out, names, shared)
    if as_json:
        click.echo(json.dumps(content))
    elif not quiet:
        click.echo("\n".join(comparison.table(content)))
        click.echo(str(out / "reports" / comparison.FOLDER / "forest.pdf"))


@main.command("compare-runs")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@common
def compare_runs(a: Path, b: Path, as_json: bool, quiet: bool, **_: Any) -> None:
    """What changed between two finished runs of a campaign: inputs, options, versions, numbers.

    A and B are folders with provenance.json (processed/CAMPAIGN), or workspaces with one finished
    campaign each.
    """
    from nearlift.run.store import plain
    from nearlift.stages import compare_runs as comparison

    content = comparison.run(a, b)
    if as_json:
        click.echo(json.dumps(plain(content)))
    elif not quiet:
        click.echo("\n".join(comparison.table(content)))


DIALECT = click.option(
    "--dialect",
    default="",
    metavar="KEYS",
    help=(
        'How to read the text, as [records] dialect in a manifest: \'separator = "semicolon",'
        ' decimal = ",", encoding = "latin-1"\'.'
    ),
)


@main.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--from",
    "given",
    is_flag=True,
    help=(
        "FILES follow: records that are there already, or their folders. The manifest says what"
        " they say."
    ),
)
@DIALECT
@common
def new(
    folder: Path,
    files: tuple[Path, ...],
    given: bool,
    dialect: str,
    quiet: bool,
    as_json: bool,
    **_: Any,
) -> None:
    """A campaign folder to fill in, with a commented manifest.

    With --from FILES, the folder of a campaign whose records are FILES: those in the folder stay,
    others are copied into it.
    """
    from nearlift.stages.inspection import dialect_of
    from nearlift.stages.template import write_from, write_template

    if given != bool(files):
        raise UsageError(
            "--from",
            "names no files" if given else "is missing before the files",
            "nearlift new DIR --from FILES",
        )
    if given:
        made, left = write_from(folder, files, dialect_of(dialect))
        if as_json:
            click.echo(json.dumps({"written": [str(path) for path in made], "fill_in": left}))
        elif not quiet:
            click.echo(
                "\n".join(
                    [
                        *(str(path) for path in made[:2]),
                        "still to fill in:",
                        *(f"  {item}" for item in left),
                    ]
                )
            )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    written = [str(path) for path in write_template(folder)]
    if as_json:
        click.echo(json.dumps({"written": written}))
    elif not quiet:
        click.echo("\n".join(written))


EXPORTS = {
    "netcdf": "posterior.nc: draws of every model, for ArviZ and xarray.",
    "c": "export/lift_model.h: a C99 header for firmware, floats only.",
    "document": "export/lift_model.json, and its JSON Schema.",
    "python": "export/lift_model.py: a module that needs nothing but Python.",
    "casadi": "export/lift_model_casadi.py: a module of CasADi expressions.",
}


def _exports(command: Callable[..., Any]) -> Callable[..., Any]:
    """A flag for every format."""
    for name, meaning in reversed(EXPORTS.items()):
        command = click.option(f"--{name}", is_flag=True, help=meaning)(command)
    return command


@main.command()
@CAMPAIGN
@_exports
@common
def export(
    campaign: Path,
    out: Path,
    executor: str,
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: bool,
    **formats: bool,
) -> None:
    """What was fitted, in forms that other programs read. Stage fit must have run."""
    from nearlift.stages.export import export as write

    wanted = tuple(name for name, asked in formats.items() if asked)
    if not wanted:
        raise UsageError(
            "export", "no format was asked for", f"add {', '.join(f'--{name}' for name in formats)}"
        )
    with open_job(campaign, out, "serial", seed, Voice(quiet, verbose, as_json), keep=False) as job:
        written = write(job, wanted)
    if as_json:
        click.echo(json.dumps({"campaign": job.campaign.name, "written": written}))
    elif not quiet:
        click.echo("\n".join(written))


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@DIALECT
@common
def inspect(file: Path, dialect: str, as_json: bool, **_: Any) -> None:
    """What FILE holds, channel by channel, and the [records] block for a manifest."""
    from nearlift.stages import inspection

    found = inspection.inspect(file, inspection.dialect_of(dialect))
    click.echo(
        json.dumps(inspection.as_json(found))
        if as_json
        else inspection.described(found).rstrip("\n")
    )


@main.command()
@CAMPAIGN
@common
def verify(campaign: Path, out: Path, as_json: bool, quiet: bool, **_: Any) -> None:
    """Hash every input and product anew and hold them against provenance.json; exit code 4 where
    one differs.
    """
    from nearlift.manifest import campaign as manifests
    from nearlift.stages.verify import differences

    checked, differing = differences(campaign, out, manifests.load(campaign))
    if as_json:
        click.echo(json.dumps({"checked": checked, "differing": differing}))
    elif not quiet:
        click.echo(
            "\n".join(
                [*differing, f"{checked - len(differing)} of {checked} files are what they were"]
            )
        )
    if differing:
        sys.exit(4)


@main.command()
@click.argument("name", required=False)
@common
def describe(name: str | None, as_json: bool, **_: Any) -> None:
    """A model, effect, product or symbol; without a name, the catalogue."""
    from nearlift.describe import describe as text

    found = text(name)
    click.echo(json.dumps({"name": name, "text": found}) if as_json else found)


REGISTRY = click.option(
    "--registry",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Another list of data sets, in the form of nearlift's own.",
)


@main.group()
def data() -> None:
    """Public measured data: what there is, and how to get it as a campaign."""


@data.command("list")
@REGISTRY
@common
def data_list(registry: Path | None, as_json: bool, **_: Any) -> None:
    """What there is: name, what was measured, licence, size."""
    from nearlift.datasets.registry import OWN, datasets
    from nearlift.run.lock import size

    found = datasets(registry or OWN)
    if as_json:
        click.echo(json.dumps([item.model_dump() for item in found]))
        return
    for item in found:
        held = (
            "size unknown"
            if any(f.bytes is None for f in item.file)
            else size(sum(f.bytes or 0 for f in item.file))
        )
        files = f"{len(item.file)} file{'s' if len(item.file) > 1 else ''}, {held}"
        unchecked = "its digest is not known: wants --trust" if item.unknown else ""
        lines = (
            item.title,
            f"{files}; licence: {item.licence}",
            item.citation,
            item.note,
            unchecked,
        )
        click.echo("\n".join([item.name, *(f"  {line}" for line in lines if line)]))


@data.command("get")
@click.argument("name")
@click.argument("folder", type=click.Path(path_type=Path), required=False, metavar="[DIR]")
@click.option("--trust", is_flag=True, help="Take files whose digest nobody has worked out.")
@click.option(
    "--cache",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where fetched files are kept [default: NEARLIFT_CACHE, or the system's].",
)
@REGISTRY
@common
def data_get(
    name: str,
    folder: Path | None,
    trust: bool,
    cache: Path | None,
    registry: Path | None,
    quiet: bool,
    verbose: bool,
    as_json: bool,
    **_: Any,
) -> None:
    """Fetch NAME and make it a campaign in DIR (default: raw/NAME). What the cache holds is not
    fetched again.
    """
    from nearlift.datasets.fetch import get
    from nearlift.datasets.registry import OWN, dataset

    voice = Voice(quiet, verbose, as_json)
    wanted = dataset(name, registry or OWN)
    made = get(wanted, folder or Path("raw") / name, trust=trust, cache=cache, say=voice.line)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "campaign": str(made),
                    "licence": wanted.licence,
                    "citation": wanted.citation,
                    "next": f"{wanted.next} {made}",
                }
            )
        )
    elif not quiet:
        click.echo(
            f"{made}\nlicence: {wanted.licence}; cite: {wanted.citation}\nnext: {wanted.next}"
            f" {made}"
        )


@main.command()
@common
def doctor(out: Path, as_json: bool, quiet: bool, **_: Any) -> None:
    """Whether this machine is fit to run nearlift; ends with 2 where it is not."""
    from dataclasses import asdict

    from nearlift.stages import doctor as surgery

    findings = surgery.examine(out)
    if as_json:
        click.echo(json.dumps([asdict(f) for f in findings]))
    elif not quiet:
        for f in findings:
            click.echo(
                f"{f.state:<6}{f.what:<15}{f.found}"
                + (f"  ({f.remedy})" if f.state != "good" and f.remedy else "")
            )
    sys.exit(UsageError.exit_code if any(f.state == "bad" for f in findings) else 0)


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """The script that completes nearlift's words in SHELL: put its output where the shell looks,
    e.g. ~/.bash_completion.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(main, {}, "nearlift", "_NEARLIFT_COMPLETE").source())
