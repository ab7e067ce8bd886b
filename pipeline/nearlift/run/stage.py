"""What a stage is, as data: the command line, the plan, the documentation and the tests' lists are
made of it.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from nearlift import blas
from nearlift.run.schema import Product

if TYPE_CHECKING:
    from nearlift.run.job import Job, Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """An option of a stage's command.

    Text unless it is one of `choices`, a whole number within `limits`, or `real`.
    """

    flag: str
    help: str
    choices: tuple[str, ...] = ()
    limits: tuple[int, int] | None = None
    real: bool = False
    metavar: str | None = None

    @property
    def name(self) -> str:
        """The flag as a Python name."""
        return self.flag.removeprefix("--").replace("-", "_")


@dataclass(frozen=True, slots=True, kw_only=True)
class StageQuestion:
    """What a stage's command answers in place of running the stage, where one of these options is
    given: by `module`'s function ``answer(campaign, given, settings)``; `example` is such a call's
    options.
    """

    module: str
    options: tuple[Option, ...]
    example: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageChapter:
    """The chapter of the report in which a stage's products are shown.

    Attributes
    ----------
    title : str
    figures : tuple of str
        Names of modules under `report.figures`, each with its `FIGURE`.
    facts : str
        Function, as ``module:name``, from evidence to what the template of the stage's name prints;
        empty where the chapter is its figures.
    """

    title: str
    figures: tuple[str, ...] = ()
    facts: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One verb: what it reads and writes, and the module whose ``run(job)`` does it, imported only
    when it runs.

    Attributes
    ----------
    name : str
        Also its command's, and its declaration's file's.
    summary : str
        What is said when it begins, and its line in the list of commands; at most 60 letters.
    help : str
        What its command's help says besides, such as when it runs.
    reads, writes : tuple of Product
        A `report` reads every product.
    sections : tuple of str
        Sections of the manifest that enter what it writes: a change in one makes it stale.
    raw, piv : bool
        It reads the records; it reads the velocity grids.
    where : str
        It belongs to a run only where the campaign has that.
    options : tuple of Option
        Of its command; each stands in for a key of the manifest's section of the stage's name.
    question : StageQuestion or None
        What its command answers instead.
    module : str
        Full name; ``nearlift.stages.<name>`` unless given.
    chapter : StageChapter or None
        Its chapter of the report, unless the report gives it a place of its own.
    """

    name: str
    summary: str
    help: str = ""
    reads: tuple[Product, ...] = ()
    writes: tuple[Product, ...] = ()
    sections: tuple[str, ...] = ()
    raw: bool = False
    piv: bool = False
    report: bool = False
    where: str = ""
    options: tuple[Option, ...] = ()
    question: StageQuestion | None = None
    module: str = ""
    chapter: StageChapter | None = None

    def configured(self, job: Job) -> bool:
        """Whether this campaign asks for the stage."""
        return not self.where or getattr(job.campaign, self.where) is not None

    def run(self, job: Job) -> Outcome:
        """Do it, on one BLAS thread."""
        module = importlib.import_module(self.module or f"nearlift.stages.{self.name}")
        with blas.one_thread():
            outcome: Outcome = module.run(job)
        return outcome
