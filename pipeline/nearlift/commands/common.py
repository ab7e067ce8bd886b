"""What the commands share: the options of all of them, how they end, and what the user hears."""

from __future__ import annotations

import contextlib
import functools
import json
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from nearlift.commands import ABOUT, About
from nearlift.errors import INTERRUPTED, ManifestError, NearliftError, UsageError, brief
from nearlift.printing import say
from nearlift.stages import STAGES

if TYPE_CHECKING:
    from nearlift.commands.bar import Bar
    from nearlift.run.engine import Job

CAMPAIGN = click.argument("campaign", type=click.Path(path_type=Path))
DIALECT = click.option(
    "--dialect",
    default="",
    metavar="KEYS",
    help=(
        'How to read the text, as [records] dialect in a manifest: \'separator = "semicolon",'
        ' decimal = ",", encoding = "latin-1"\'.'
    ),
)
#: Settings that a command takes where they do something.
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


@dataclass(kw_only=True)
class Call:
    """The settings of a command, and by them what the user hears: progress on a terminal, plain
    lines elsewhere, nothing when quiet.
    """

    out: Path = Path()
    executor: str = "serial"
    seed: int = 0
    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    bar: Bar | None = None

    @property
    def silent(self) -> bool:
        """Whether nothing but the answer is to be said."""
        return self.quiet or self.as_json

    def line(self, text: str) -> None:
        """One line for the user."""
        if self.bar is not None:
            self.bar.line(text)
        elif not self.silent:
            say(text, err=True)

    def progress(self, text: str, share: float | None = None, /) -> None:
        """A passing remark and the share done, on a terminal; elsewhere the remark, with -v."""
        if self.bar is not None:
            self.bar.show(text, share)
        elif self.verbose:
            self.line(f"  {text}")

    @contextlib.contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show on a terminal what is going on, for how long, and how long still."""
        if self.silent or sys.stderr is None or not sys.stderr.isatty():
            yield
            return
        from nearlift.commands.bar import Bar

        self.bar = Bar(text)
        with self.bar.progress:
            yield
        self.bar = None

    def answer(self, content: Any, text: str) -> None:
        """The command's answer on stdout: as JSON where asked for, else in words unless quiet."""
        if self.as_json:
            say(json.dumps(content))
        elif not self.quiet:
            say(text.rstrip("\n"))

    def answers(self, kind: str, each: Sequence[tuple[Any, str]]) -> None:
        """Answer for several files or campaigns; JSON lists them under `kind`, unless it is one."""
        contents, texts = [content for content, _ in each], [text for _, text in each]
        self.answer(contents[0] if len(each) == 1 else {kind: contents}, "\n\n".join(texts))

    def job(
        self, campaign: Path, executor: str = "", keep: bool = False, planned: bool = False
    ) -> contextlib.AbstractContextManager[Job]:
        """The campaign as a job, serial unless said otherwise; `keep` what it knows of its inputs;
        `planned`: it has no records yet.
        """
        from nearlift.run.workers import open_campaign

        return open_campaign(
            campaign,
            self.out,
            STAGES,
            executor or "serial",
            self.seed,
            say=self.progress,
            keep=keep,
            planned=planned,
        )


def workspace(campaigns: Iterable[Path]) -> Path:
    """The folder of ``processed/`` and ``reports/`` unless another is named: the current one; from
    within the folder ``raw`` that holds the first of `campaigns`, the folder that holds ``raw``.
    """
    here = Path.cwd()
    for campaign in campaigns:
        raw = next((above for above in campaign.resolve().parents if above.name == "raw"), None)
        return raw.parent if raw is not None and here.is_relative_to(raw) else Path()
    return Path()


def declared(name: str) -> Callable[[Callable[..., None]], click.Command]:
    """Make a function the command of that name."""

    def made(function: Callable[..., None]) -> click.Command:
        return command(function, name, ABOUT[name])

    return made


def command(function: Callable[..., None], name: str, about: About) -> click.Command:
    """A command with the contract's exit codes; the function gets its settings as ``call``."""
    settings = [SETTINGS[key] for key in about.settings] + list(EVERYWHERE)

    @functools.wraps(function)
    def guarded(**given: Any) -> None:
        call = Call(**{str(option.name): given.pop(str(option.name)) for option in settings})
        try:
            if call.out is None:
                one = [given["campaign"]] if "campaign" in given else []
                call.out = workspace(given.get("campaigns") or given.get("files") or one)
            function(call=call, **given)
        except NearliftError as refusal:
            _end(call, refusal, refusal.exit_code, f"error: {refusal}")
        except (KeyboardInterrupt, click.Abort):
            stopped = NearliftError(
                "nearlift",
                "interrupted",
                "finished products remain, and the same command continues from there",
            )
            _end(call, stopped, INTERRUPTED, f"{stopped.what}; {stopped.remedy}")
        except BrokenPipeError:
            raise
        except OSError as fault:
            what = (fault.strerror or str(fault)).lower()
            remedy = "check that it exists, who may read and write it, and the space on the disk"
            failed = NearliftError(str(fault.filename or "nearlift"), what, remedy)
            _end(call, failed, failed.exit_code, f"error: {failed}")

    made = click.command(name, help=about.page, epilog=about.epilog)(guarded)
    made.params.extend(settings)
    return made


def _end(call: Call, refusal: NearliftError, code: int, text: str) -> NoReturn:
    if call.as_json:
        said = {"where": refusal.where, "what": refusal.what, "remedy": refusal.remedy}
        say(json.dumps({"exit_code": code, **said}))
    say(text, err=True)
    sys.exit(code)


def padded(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row, its cells one below the other, the last as long as it is."""
    *wide, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
    return [
        "  ".join((*(cell.ljust(w) for cell, w in zip(row, wide, strict=False)), row[-1])).rstrip()
        for row in rows
    ]


def end_politely() -> None:
    """A batch system's polite end is an interrupt as well."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def dialect_of(text: str) -> dict[str, object]:
    """What a manifest would read of ``dialect = { text }``; the braces may stand there.

    Raises
    ------
    UsageError
        It is no TOML.
    """
    from nearlift.campaign import parsing

    plain = text.strip()
    try:
        dialect: dict[str, object] = parsing.loads(
            b"dialect = " + (plain if plain.startswith("{") else f"{{ {plain} }}").encode(), "it"
        )["dialect"]
    except ManifestError as fault:
        remedy = """such as --dialect 'separator = "semicolon", decimal = ","'"""
        raise UsageError(
            "--dialect", f"{brief(repr(text))} is not as a manifest has it: {fault.what}", remedy
        ) from None
    return dialect
