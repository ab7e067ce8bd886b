"""Output, refusals, progress and runs of all commands."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from nearlift.errors import INTERRUPTED, SOME_TRIALS_REJECTED, NearliftError, did_you_mean
from nearlift.printing import printable, say
from nearlift.rounding import bytes_text
from nearlift.run.tables import LEDGER
from nearlift.stages import STAGES

if TYPE_CHECKING:
    from rich.progress import Progress

    from nearlift.run.engine import Job, Stage, Step

#: Headings of the list of commands, in its order.
HEADINGS = ("Begin", "Run", "Single stages, in the order of a run", "Afterwards", "Look up")
#: Rejected trials listed without -v.
MAX_REJECTED_LISTED = 10
#: Window of the estimate of the time left, s; one fold of a diagnosis may take a minute.
SPEED_WINDOW_S = 3600.0
#: Time after which an interrupt that no command has heard is repeated, s.
REPEAT_S = 1.0
#: Options of every command.
COMMON = (
    click.Option(
        ["--out"],
        type=click.Path(path_type=Path, file_okay=False),
        show_default="the current folder, within raw/ the one that holds it",
        help="Folder that holds processed/ and reports/.",
    ),
    click.Option(
        ["--executor"],
        default="auto",
        help="serial, threads:N, processes:N or dask:ADDRESS; auto: processes for large records.",
    ),
    click.Option(["--seed"], type=int, default=0, help="Seed of everything random."),
    click.Option(
        ["--json", "as_json"], is_flag=True, help="One JSON object on stdout instead of text."
    ),
    click.Option(["-q", "--quiet"], is_flag=True, help="Say nothing but errors."),
    click.Option(["-v", "--verbose"], is_flag=True, help="Say more."),
)


@dataclass(kw_only=True)
class Call:
    """Settings of a call and its output.

    Progress is shown on a terminal, as plain lines elsewhere, and not at all when quiet.
    """

    out: Path = Path()
    executor: str = "serial"
    seed: int = 0
    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    bar: Progress | None = None

    def line(self, text: str) -> None:
        """Print one line on stderr."""
        if self.bar is not None:
            self.bar.console.print(
                printable(text), markup=False, highlight=False, emoji=False, soft_wrap=True
            )
        elif not (self.quiet or self.as_json):
            say(text, err=True)

    def progress(self, text: str, share: float | None = None, /) -> None:
        """Show an activity and the share done on a terminal; elsewhere print it with -v.

        Another first word starts the clock again.
        """
        if self.bar is None:
            if self.verbose:
                self.line(f"  {text}")
            return
        (task,) = self.bar.tasks
        number, shown = task.id, printable(text)
        if shown.split()[0] != task.description.split()[0]:
            self.bar.remove_task(number)
            number = self.bar.add_task(shown, total=None)
        total = None if share is None else 1.0
        self.bar.update(number, description=shown, total=total, completed=share)

    @contextlib.contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show a progress line while the block runs, on a terminal only."""
        if self.quiet or self.as_json or sys.stderr is None or not sys.stderr.isatty():
            yield
            return
        from rich import progress
        from rich.console import Console

        with progress.Progress(
            progress.SpinnerColumn(),
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(bar_width=20),
            progress.TaskProgressColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(compact=True),
            progress.TextColumn("left"),
            console=Console(stderr=True),
            transient=True,
            speed_estimate_period=SPEED_WINDOW_S,
        ) as self.bar:
            self.bar.add_task(printable(text), total=None)
            yield
        self.bar = None

    def answer(self, content: Any, text: str) -> None:
        """Print the answer on stdout: JSON where asked for, else text unless quiet."""
        if self.as_json:
            say(json.dumps(content))
        elif not self.quiet:
            say(text.rstrip("\n"))

    def answers(self, kind: str, each: Sequence[tuple[Any, str]]) -> None:
        """Print answers for several files or campaigns; JSON lists more than one under `kind`."""
        contents, texts = [content for content, _ in each], [text for _, text in each]
        self.answer(contents[0] if len(each) == 1 else {kind: contents}, "\n\n".join(texts))

    def job(
        self, campaign: Path, executor: str = "serial", fresh: bool = False, planned: bool = False
    ) -> contextlib.AbstractContextManager[Job]:
        """Open a campaign; see `run.engine.open_job`."""
        from nearlift.run.engine import open_job

        given = (campaign, self.out, STAGES, executor, self.seed)
        return open_job(*given, say=self.progress, fresh=fresh, planned=planned)

    def refuse(self, refusal: NearliftError, code: int) -> NoReturn:
        """Print a refusal and exit."""
        if self.as_json:
            where = {"where": refusal.where, "what": refusal.what, "remedy": refusal.remedy}
            say(json.dumps({"exit_code": code, **where}))
        say(f"error: {refusal}", err=True)
        sys.exit(code)


class Command(click.Command):
    """Command with the contract's options and exit codes; its function gets them as ``call``.

    The function's docstring is the help: a summary line of at most 60 letters, then text.

    Parameters
    ----------
    heading : str
        Heading of the list of commands under which it is listed.
    example : str
        Calls without ``nearlift``, a line each.
    """

    def __init__(self, *args: Any, heading: str = "", example: str, **more: Any) -> None:
        super().__init__(*args, **more)
        self.heading = heading
        calls = "\n".join(f"  nearlift {line}" for line in example.splitlines())
        self.epilog = f"\b\nFor example:\n{calls}"
        self.params.extend(COMMON)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the command's own options, then those of every command."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        specific = [option for option in options if option not in COMMON]
        for title, each in (("Options", specific), ("Options of every command", COMMON)):
            with formatter.section(title):
                formatter.write_dl([row for p in each if (row := p.get_help_record(ctx))])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a refusal ends with its exit code."""
        call = Call(**{str(option.name): ctx.params.pop(str(option.name)) for option in COMMON})
        call.out = call.out or workspace()
        ctx.params["call"] = call
        try:
            with interruptible():
                return super().invoke(ctx)
        except NearliftError as refusal:
            call.refuse(refusal, refusal.exit_code)
        except (KeyboardInterrupt, click.Abort):
            remedy = "finished products remain, and the same command continues from there"
            call.refuse(NearliftError("nearlift", "interrupted", remedy), INTERRUPTED)
        except BrokenPipeError:
            raise
        except OSError as fault:
            what = (fault.strerror or str(fault)).lower()
            remedy = "check that it exists, its permissions, and the space on the disk"
            failed = NearliftError(str(fault.filename or "nearlift"), what, remedy)
            call.refuse(failed, failed.exit_code)


class Commands(click.Group):
    """Group whose help lists commands by heading, and which proposes a command for a slip."""

    command_class = Command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; if there is none of that name, propose one."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as refusal:
            hint = did_you_mean(args[0], list(self.commands))
            advice = f"{refusal.message.rstrip('.')}: {hint}" if hint else refusal.message
            raise click.UsageError(advice, ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List every command with its summary, under its heading."""
        for heading in HEADINGS:
            rows = [
                (f"{name:<12}", (command.help or "").split("\n")[0].rstrip("."))
                for name, command in self.commands.items()
                if getattr(command, "heading", HEADINGS[0]) == heading
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


def workspace() -> Path:
    """Default of ``--out``: the current folder; within ``raw``, the folder that holds it."""
    here = Path.cwd()
    return next((p.parent for p in (here, *here.parents) if p.name == "raw"), Path())


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Treat SIGTERM, a batch system's end, as Ctrl-C; repeat an interrupt that a library loses."""

    def interrupt(*_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, REPEAT_S)
        raise KeyboardInterrupt

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            sys.__unraisablehook__(lost)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before, hook = [signal.signal(number, interrupt) for number in numbers], sys.unraisablehook
    sys.unraisablehook = unraisable
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        sys.unraisablehook = hook
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def execute(call: Call, campaign: Path, only: str | None = None) -> NoReturn:
    """Run the stale stages of a campaign, or `only` one, and exit with the contract's code."""
    from nearlift.run import engine

    if call.executor.startswith("dask"):
        execute_many(call, (campaign,), only)
    wanted = STAGES if only is None else (engine.stage_of(STAGES, only),)
    steps: list[Step] = []
    # None: every stage was up to date, and no product is read
    before: dict[str, str] | None = None
    after: dict[str, str] = {}
    with call.job(campaign, call.executor) as job:

        def begin(stage: Stage, why: str) -> None:
            nonlocal before
            if before is None:
                before = _answers(job) if (job.processed / LEDGER).is_file() else {}
            if stage.name == "ingest":
                size = bytes_text(sum(size for size, _ in job.stamps.values()))
                why = f"{why}; {len(job.stamps)} files with {size}"
            call.line(f"{stage.name:<8} {stage.summary} ({why})")
            if call.bar is not None:
                call.progress(stage.name)

        with call.busy(f"nearlift: {job.campaign.name}"):
            for step in engine.run(job, wanted, begin=begin, force=only is not None):
                if not step.why:
                    call.line(f"{step.stage.name:<8} up to date")
                for note in step.outcome.notes:
                    call.line(f"  note: {note}")
                steps.append(step)
        if before:
            after = _answers(job)
    rejected = [trial for step in steps for trial in step.outcome.rejected]
    _list_rejected(call, rejected)
    report = job.reports / "index.html"
    reported = report.is_file() and wanted[-1].report
    if reported:
        call.line(f"\n{(job.reports / 'summary.txt').read_text(encoding='utf-8')}")
    if before or before is None:
        both = [(key, now, (before or {}).get(key, "none")) for key, now in after.items()]
        changes = [f"  {key}: {now} (was {was})" for key, now, was in both if now != was]
        summary = "changed since the last run:" if changes else "unchanged since the last run"
        call.line("\n".join([summary, *changes]))
    code = SOME_TRIALS_REJECTED if rejected else 0
    stages = [
        {"stage": step.stage.name, "why": step.why, "notes": step.outcome.notes}
        | {"rejected": step.outcome.rejected, "wall_s": step.wall_s}
        for step in steps
    ]
    content = {"campaign": job.campaign.name, "exit_code": code, "stages": stages}
    content["report"] = str(report) if report.is_file() else None
    if call.as_json or reported:
        call.answer(content, str(report))
    sys.exit(code)


def _answers(job: Job) -> dict[str, str]:
    """Results that are there so far, in words; see `stages.looks`."""
    from nearlift.stages import looks

    return looks.answers(job)


def _list_rejected(call: Call, rejected: Sequence[tuple[str, str]]) -> None:
    shown = rejected if call.verbose else rejected[:MAX_REJECTED_LISTED]
    if rejected:
        call.line(f"{len(rejected)} trial{'s' * (len(rejected) > 1)} rejected:")
    for trial, reason in shown:
        call.line(f"  {trial}: {reason}")
    if len(rejected) > len(shown):
        call.line(f"  ... and {len(rejected) - len(shown)} more (-v lists all)")


def execute_many(call: Call, campaigns: Sequence[Path], only: str | None = None) -> NoReturn:
    """Run several campaigns, going on after a refusal; exit with the most serious code."""
    from nearlift.run.campaigns import most_serious, run_campaigns
    from nearlift.stages import looks

    ends = []
    many = f"{len(campaigns)} campaigns"
    with call.busy(f"nearlift: {many}"):
        for one in run_campaigns(
            campaigns, call.out, STAGES, call.executor, call.seed, looks.line, only
        ):
            call.line(f"{one.campaign:<24}{one.words}")
            ends.append(one)
            call.progress(f"nearlift: {len(ends)} of {many}", len(ends) / len(campaigns))
    if call.as_json:
        say(json.dumps({"campaigns": [asdict(one) for one in ends]}))
    sys.exit(most_serious(ends))
