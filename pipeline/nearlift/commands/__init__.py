"""The commands, a file each, imported when it is asked for; those of stages are made of the stages'
declarations.

A new command is one more entry and a file of its name, with `command` in it.
"""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.run.engine import Stage
from nearlift.stages import STAGES

#: Headings of the list of commands, in its order.
GROUPS = ("Begin", "Run", "Single stages, in the order of a run", "Afterwards", "Look up")
BEGIN, RUN, SINGLE, AFTERWARDS, LOOK_UP = GROUPS
#: Settings of whatever opens a campaign, and of what computes something.
OPENS = ("out", "seed", "verbose")
COMPUTES = ("out", "executor", "seed", "verbose")


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """What the help of a command says: its `group` of `GROUPS`; its line in the list of commands,
    without a full stop and of at most 60 letters; what else its own page says; calls that make
    sense, a line each, without ``nearlift``; and those of `common.SETTINGS` that do something here.
    """

    group: str
    summary: str
    text: str = ""
    example: str
    settings: tuple[str, ...] = ()

    @property
    def page(self) -> str:
        """The text above the options."""
        return f"{self.summary}.\n\n{self.text}".rstrip()

    @property
    def epilog(self) -> str:
        """The text below them."""
        calls = (f"  nearlift {line}" for line in self.example.splitlines())
        return "\b\n" + "\n".join(("For example:", *calls))


#: Each command that is no stage.
ABOUT = {
    "compare": About(
        group=AFTERWARDS,
        summary="One coefficient over many campaigns, with a forest plot",
        text=(
            "Table, forest plot and population mean over finished campaigns; without names, all."
            " The mean does not average down shared errors."
        ),
        example="compare rig-a rig-b",
        settings=("out",),
    ),
    "data": About(
        group=BEGIN,
        summary="Public measured data: what there is, fetched as a campaign",
        example="data list\ndata get pitt-ras-2017",
    ),
    "data list": About(
        group=BEGIN,
        summary="What there is: name, what was measured, licence, size",
        example="data list",
    ),
    "data get": About(
        group=BEGIN,
        summary="Fetch NAME and make it a campaign",
        text="It is made in DIR (default: raw/NAME). What the cache holds is not fetched again.",
        example="data get pitt-ras-2017",
    ),
    "demo": About(
        group=BEGIN,
        summary="A simulated campaign, end to end",
        text="It is written to demo-campaign/ and run; it needs nothing but the package.",
        example="demo",
        settings=COMPUTES,
    ),
    "describe": About(
        group=LOOK_UP,
        summary="A model, effect, product or symbol; or the catalogue",
        example="describe\ndescribe sanchez_cuevas",
    ),
    "design": About(
        group=BEGIN,
        summary="Detectable effects of a planned campaign, and a random schedule",
        text=(
            "For CAMPAIGN before it is run: detectable effects, confounded effects, and changes"
            " to the plan. The plan is the folder's schedule, or the manifest's [design]."
        ),
        example="design raw/my-rig --write raw/my-rig/planned.csv",
        settings=OPENS,
    ),
    "export": About(
        group=AFTERWARDS,
        summary="The fitted model, in forms that other programs read",
        text="Stage fit must have run.",
        example="export raw/my-rig --c --netcdf",
        settings=("out", "verbose"),
    ),
    "explain": About(
        group=AFTERWARDS,
        summary="One effect, and its visibility in this campaign",
        text=(
            "The effect, its detectable size in this campaign, and the effects confounded with it."
            " Stage ingest must have run. `diagnose --explain` is the same."
        ),
        example="explain raw/my-rig supply_sag",
        settings=OPENS,
    ),
    "inspect": About(
        group=BEGIN,
        summary="What a file holds, and the lines for the manifest",
        text=(
            "Channel by channel, with the tables of a manifest that read it: [records] of a record,"
            " [piv] of a velocity grid, the schedule's units of a table of means."
        ),
        example="inspect logs/run-1.csv\ninspect --cuts raw/my-rig",
        settings=("out",),
    ),
    "new": About(
        group=BEGIN,
        summary="A campaign folder to fill in, empty or from records",
        text=(
            "With --from FILES, the folder of a campaign whose records are FILES: those in the"
            " folder stay, others are copied into it. What no file says is marked FILL IN."
        ),
        example="new raw/my-rig\nnew raw/my-rig --from logs/*.csv",
    ),
    "next": About(
        group=RUN,
        summary="The next visits, for a coefficient or to distinguish two effects",
        text=(
            "Chosen from the campaign's trials, with a share at all stations. Prints their gain,"
            " where to stop, and their cost. Stages ingest and, for identified effects, diagnose"
            " must have run. Nothing is written."
        ),
        example=(
            "next raw/my-rig --for K_b --until 0.05\nnext raw/my-rig --for separate --csv"
            "\nnext raw/my-rig --for drift"
        ),
        settings=OPENS,
    ),
    "run": About(
        group=RUN,
        summary="Every stage of a campaign that is stale",
        text="Of several campaigns, one after the other, or side by side with processes:N.",
        example=(
            "run raw/my-rig\nrun raw/a raw/b --executor processes:2\nrun --dry-run raw/my-rig"
            "\nrun --check raw/my-rig"
        ),
        settings=COMPUTES,
    ),
    "serve": About(
        group=RUN,
        summary="Campaigns, live view and reports in a browser",
        text=(
            "A read-only page for this machine alone, behind a link that is good once. WORKSPACE"
            " (default: the current folder) holds processed/ and reports/. `nearlift run --watch`"
            " brings the page up to date while a campaign is recorded."
        ),
        example="serve\nserve ~/lift --port 8765",
    ),
}


def about_stage(stage: Stage) -> About:
    """The same of a stage's command."""
    written = ", ".join(product.file for product in stage.writes)
    parts = (
        f"Writes {written}." if written else "",
        stage.help,
        "Runs even if it is up to date; earlier stages must have run.",
    )
    asked = f"\n{stage.name} raw/my-rig {stage.question.example}" if stage.question else ""
    return About(
        group=SINGLE,
        summary=stage.summary[0].upper() + stage.summary[1:],
        text=" ".join(filter(None, parts)),
        example=f"{stage.name} raw/my-rig{asked}",
        settings=COMPUTES,
    )


def everything() -> dict[str, About]:
    """Every command of the first level: a run's stages in their order, all others by name."""
    stages = {stage.name: about_stage(stage) for stage in STAGES}
    return {name: ABOUT[name] for name in sorted(ABOUT) if " " not in name} | stages
