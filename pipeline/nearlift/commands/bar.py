"""A line on the terminal while something takes its time: what, how much is done, how long still."""

from __future__ import annotations

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from nearlift.printing import printable

#: What the speed is reckoned from, s: a fold may take a minute.
PERIOD_S = 3600.0


class Bar:
    """Gone when its `progress` ends; lines that are printed meanwhile stand above it."""

    def __init__(self, title: str) -> None:
        self.activity = ""
        self.progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(compact=True),
            TextColumn("left"),
            console=Console(stderr=True),
            transient=True,
            speed_estimate_period=PERIOD_S,
        )
        self.task = self.progress.add_task(printable(title), total=None)

    def show(self, text: str, share: float | None = None) -> None:
        """Say what is being done; times begin anew with another first word."""
        activity, total = text.split(" ", 1)[0], None if share is None else 1.0
        if activity != self.activity:
            self.activity = activity
            self.progress.remove_task(self.task)
            self.task = self.progress.add_task(printable(text), total=None)
        self.progress.update(self.task, description=printable(text), total=total, completed=share)

    def line(self, text: str) -> None:
        """A line that stays, above this one."""
        self.progress.console.print(
            printable(text), markup=False, highlight=False, emoji=False, soft_wrap=True
        )
