"""The command line: names to commands. What a command imports is loaded only when it is asked
for.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

import click

from nearlift.blas import default_to_one_thread

# before numpy is first imported
default_to_one_thread()
# what a manifest means is for nearlift to say, and to look for packages that would have a say takes
# longer than to check it
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

from nearlift import __version__  # noqa: E402
from nearlift.commands import GROUPS, everything  # noqa: E402
from nearlift.errors import did_you_mean  # noqa: E402
from nearlift.run.engine import stage_of  # noqa: E402
from nearlift.stages import ORDER, STAGES  # noqa: E402

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _meant(word: str) -> str:
    """What somebody may mean who calls a command by this word: an option of a stage's command, or a
    name like it.
    """
    for stage in STAGES:
        asked = stage.question.options if stage.question else ()
        if option := next((o for o in (*stage.options, *asked) if o.name == word), None):
            value = option.metavar or option.name.upper()
            return f"try 'nearlift {stage.name} CAMPAIGN {option.flag} {value}'"
    return did_you_mean(word, everything())


class Commands(click.Group):
    """The commands by name, each loaded when it is called or its own help is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every name."""
        return list(everything())

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """The command of that name."""
        if name in ORDER:
            from nearlift.commands.stage import command_of

            return command_of(stage_of(STAGES, name))
        if name not in everything():
            return None
        module = importlib.import_module(f"nearlift.commands.{name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is meant; where none has that name, what may be meant is proposed."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as refusal:
            hint = _meant(args[0])
            advice = f"{refusal.message.rstrip('.')}: {hint}" if hint else refusal.message
            raise click.UsageError(advice, ctx) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Every name with its summary, under its group."""
        listed = everything()
        for group in GROUPS:
            with formatter.section(group):
                formatter.write_dl(
                    [(f"{n:<12}", a.summary) for n, a in listed.items() if a.group == group]
                )

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names that begin so, then this group's options."""
        from click.shell_completion import CompletionItem

        names = [CompletionItem(n) for n in self.list_commands(ctx) if n.startswith(incomplete)]
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]


@click.command(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(__version__, prog_name="nearlift")
def main() -> None:
    """Near-boundary lift of tethered rotorcraft: from load-cell records to models with honest
    uncertainty.

    Exit codes: 0 done; 2 usage or manifest; 3 done, some trials rejected; 4 input unreadable or
    refused; 5 a fit did not converge; 130 interrupted.
    """
