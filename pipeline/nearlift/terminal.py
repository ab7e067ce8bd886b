"""Settings, exit codes, progress and answers of all commands."""

from __future__ import annotations

import contextlib
import functools
import json
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from nearlift.errors import INTERRUPTED, SOME_TRIALS_REJECTED, NearliftError, did_you_mean
from nearlift.printing import printable, say
from nearlift.rounding import bytes_text
from nearlift.stages import STAGES

if TYPE_CHECKING:
    from rich.progress import Progress

    from nearlift.run.engine import Job, Stage, Step

#: Headings of the list of commands, in its order.
HEADINGS = ("Begin", "Run", "Single stages, in the order of a run", "Afterwards", "Look up")
BEGIN, RUN, SINGLE, AFTERWARDS, LOOK_UP = HEADINGS
#: Rejected trials listed without -v.
MAX_REJECTED_LISTED = 10
#: Window of the estimate of the time left, s; one fold of a diagnosis may take a minute.
SPEED_WINDOW_S = 3600.0
#: Time after which an interrupt that no command has heard is repeated, s.
REPEAT_S = 1.0
#: Settings of a command that opens a campaign, and of one that computes.
OPENS = ("out", "seed", "verbose")
COMPUTES = ("out", "executor", "seed", "verbose")
SETTINGS = {
    "out": click.Option(
        ["--out"],
        type=click.Path(path_type=Path, file_okay=False),
        show_default="the current folder, within raw/ the one that holds it",
        help="Folder that holds processed/ and reports/.",
    ),
    "executor": click.Option(
        ["--executor"],
        default="threads:2",
        show_default=True,
        help="serial, threads:N, processes:N or dask:ADDRESS.",
    ),
    "seed": click.Option(
        ["--seed"], type=int, default=0, show_default=True, help="Seed of everything random."
    ),
    "verbose": click.Option(["-v", "--verbose"], is_flag=True, help="Say more."),
}
EVERYWHERE = (
    click.Option(
        ["--json", "as_json"], is_flag=True, help="One JSON object on stdout instead of text."
    ),
    click.Option(["-q", "--quiet"], is_flag=True, help="Say nothing but errors."),
)


class Commands(click.Group):
    """Group whose help lists commands by heading and whose refusals propose a command."""

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
                if getattr(command, "heading", "") == heading
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


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


class Bar:
    """Progress line on a terminal: the activity, the share done and the time left."""

    def __init__(self, title: str) -> None:
        from rich import progress
        from rich.console import Console

        self.activity = ""
        self.progress: Progress = progress.Progress(
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
        )
        self.task = self.progress.add_task(printable(title), total=None)

    def show(self, text: str, share: float | None = None) -> None:
        """Show an activity; another first word starts its clock again."""
        activity, total = text.split(" ", 1)[0], None if share is None else 1.0
        if activity != self.activity:
            self.activity = activity
            self.progress.remove_task(self.task)
            self.task = self.progress.add_task(printable(text), total=None)
        self.progress.update(self.task, description=printable(text), total=total, completed=share)

    def line(self, text: str) -> None:
        """Print a line that stays, above the progress line."""
        self.progress.console.print(
            printable(text), markup=False, highlight=False, emoji=False, soft_wrap=True
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
    bar: Bar | None = None

    def line(self, text: str) -> None:
        """Print one line on stderr."""
        if self.bar is not None:
            self.bar.line(text)
        elif not (self.quiet or self.as_json):
            say(text, err=True)

    def progress(self, text: str, share: float | None = None, /) -> None:
        """Show an activity and the share done on a terminal; elsewhere print it with -v."""
        if self.bar is not None:
            self.bar.show(text, share)
        elif self.verbose:
            self.line(f"  {text}")

    @contextlib.contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show a progress line while the block runs, on a terminal only."""
        if self.quiet or self.as_json or sys.stderr is None or not sys.stderr.isatty():
            yield
            return
        self.bar = Bar(text)
        with self.bar.progress:
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

    def end(self, refusal: NearliftError, code: int, text: str) -> NoReturn:
        """Print a refusal and exit."""
        if self.as_json:
            where = {"where": refusal.where, "what": refusal.what, "remedy": refusal.remedy}
            say(json.dumps({"exit_code": code, **where}))
        say(text, err=True)
        sys.exit(code)


def command(
    group: click.Group,
    heading: str,
    example: str,
    settings: tuple[str, ...] = (),
    name: str | None = None,
    more: Sequence[click.Option] = (),
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    r"""Make a function a command with the contract's exit codes.

    The function's docstring is the help: a summary line of at most 60 letters, then text. It gets
    its settings as ``call``.

    Parameters
    ----------
    group : click.Group
        Group that gets the command.
    heading : str
        Heading of the list of commands under which it is listed.
    example : str
        Calls without ``nearlift``, a line each.
    settings : tuple of str
        Keys of `SETTINGS` that do something in this command.
    name : str, optional
        Name, unless it is the function's.
    more : sequence of click.Option
        Options that the function gets as well.
    """
    options = [*(SETTINGS[key] for key in settings), *EVERYWHERE]
    calls = "\n".join(("For example:", *(f"  nearlift {line}" for line in example.splitlines())))

    def made(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def guarded(**given: Any) -> None:
            call = Call(**{str(option.name): given.pop(str(option.name)) for option in options})
            try:
                if call.out is None:
                    one = [given["campaign"]] if "campaign" in given else []
                    call.out = workspace(given.get("campaigns") or given.get("files") or one)
                with interruptible():
                    function(call=call, **given)
            except NearliftError as refusal:
                call.end(refusal, refusal.exit_code, f"error: {refusal}")
            except (KeyboardInterrupt, click.Abort):
                remedy = "finished products remain, and the same command continues from there"
                stopped = NearliftError("nearlift", "interrupted", remedy)
                call.end(stopped, INTERRUPTED, f"{stopped.what}; {remedy}")
            except BrokenPipeError:
                raise
            except OSError as fault:
                what = (fault.strerror or str(fault)).lower()
                remedy = "check that it exists, its permissions, and the space on the disk"
                failed = NearliftError(str(fault.filename or "nearlift"), what, remedy)
                call.end(failed, failed.exit_code, f"error: {failed}")

        registered = group.command(name or function.__name__, epilog=f"\b\n{calls}")(guarded)
        registered.params.extend((*more, *options))
        registered.heading = heading  # type: ignore[attr-defined]
        return function

    return made


def workspace(campaigns: Iterable[Path]) -> Path:
    """Default of ``--out``: the current folder; within ``raw``, the folder that holds it."""
    here = Path.cwd()
    for campaign in campaigns:
        raw = next((above for above in campaign.resolve().parents if above.name == "raw"), None)
        return raw.parent if raw is not None and here.is_relative_to(raw) else Path()
    return Path()


def execute(call: Call, campaign: Path, only: str | None = None) -> NoReturn:
    """Run the stale stages of a campaign, or `only` one, and exit with the contract's code."""
    from nearlift.run import engine

    if call.executor.startswith("dask"):
        execute_many(call, (campaign,), only)
    wanted = STAGES if only is None else (engine.stage_of(STAGES, only),)
    steps: list[Step] = []
    with call.job(campaign, call.executor) as job:
        report, summary = job.reports / "index.html", job.reports / "summary.txt"
        before = summary.read_text(encoding="utf-8") if summary.is_file() else ""

        def begin(stage: Stage, why: str) -> None:
            if stage.name == "ingest":
                size = bytes_text(sum(size for size, _ in job.stamps.values()))
                why = f"{why}; {len(job.stamps)} files with {size}"
            call.line(f"{stage.name:<8} {stage.summary} ({why})")
            if call.bar is not None:
                call.bar.show(stage.name)

        with call.busy(f"nearlift: {job.campaign.name}"):
            for step in engine.run(job, wanted, begin=begin, force=only is not None):
                if not step.why:
                    call.line(f"{step.stage.name:<8} up to date")
                for note in step.outcome.notes:
                    call.line(f"  note: {note}")
                steps.append(step)
    rejected = [trial for step in steps for trial in step.outcome.rejected]
    _list_rejected(call, rejected)
    code = SOME_TRIALS_REJECTED if rejected else 0
    stages = [
        {"stage": step.stage.name, "why": step.why, "notes": step.outcome.notes}
        | {"rejected": step.outcome.rejected, "wall_s": step.wall_s}
        for step in steps
    ]
    content = {"campaign": job.campaign.name, "exit_code": code, "report": None, "stages": stages}
    text = ""
    if report.is_file():
        content["report"] = str(report)
        if wanted[-1].report:
            after = summary.read_text(encoding="utf-8")
            call.line(f"\n{after}")
            if after == before:
                call.line("unchanged since the last run")
            text = str(report)
    if call.as_json or text:
        call.answer(content, text)
    sys.exit(code)


def _list_rejected(call: Call, rejected: Sequence[tuple[str, str]]) -> None:
    if not rejected:
        return
    call.line(f"{len(rejected)} trial{'s' * (len(rejected) > 1)} rejected:")
    shown = rejected if call.verbose else rejected[:MAX_REJECTED_LISTED]
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
            campaigns, call.out, STAGES, call.executor, call.seed, looks.verdicts, only
        ):
            call.line(f"{one.campaign:<24}{one.words}")
            ends.append(one)
            call.progress(f"nearlift: {len(ends)} of {many}", len(ends) / len(campaigns))
    if call.as_json:
        say(json.dumps({"campaigns": [asdict(one) for one in ends]}))
    sys.exit(most_serious(ends))
