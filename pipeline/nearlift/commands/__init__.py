"""The commands, a file each, imported when it is asked for; those of stages are made of the stages'
declarations.

A new command is one more entry and a file of its name, with `command` in it.
"""

from __future__ import annotations

#: Each command's help.
HELP = {
    "compare": (
        "One coefficient over many finished campaigns: table, forest plot, population mean and"
        " spread."
    ),
    "compare-runs": (
        "What changed between two finished runs of a campaign: inputs, options, versions, numbers."
        "\n\n"
        "A and B are folders with provenance.json (processed/CAMPAIGN), or workspaces with one"
        " finished campaign each."
    ),
    "completion": (
        "The script that completes nearlift's words in SHELL: put its output where the shell looks,"
        " e.g. ~/.bash_completion."
    ),
    "data": "Public measured data: what there is, and how to get it as a campaign.",
    "demo": ("The embedded, simulated campaign, end to end; needs nothing but the package."),
    "describe": "A model, effect, product or symbol; without a name, the catalogue.",
    "design": (
        "Before CAMPAIGN is run: what its plan could see, what it would confuse, what to change;"
        " draws a random schedule."
        "\n\n"
        "The plan is the folder's schedule, or the manifest's [design]."
    ),
    "doctor": "Whether this machine is fit to run nearlift; ends with 2 where it is not.",
    "export": "What was fitted, in forms that other programs read. Stage fit must have run.",
    "inspect": ("What FILE holds, channel by channel, and the [records] block for a manifest."),
    "new": (
        "A campaign folder to fill in, with a commented manifest."
        "\n\n"
        "With --from FILES, the folder of a campaign whose records are FILES: those in the folder"
        " stay, others are copied into it."
    ),
    "plan": "What is stale and why; runs nothing.",
    "run": (
        "Every stage of CAMPAIGN that is stale; of several campaigns, one after the other, or side"
        " by side with processes:N."
    ),
    "verify": (
        "Hash every input and product anew and hold them against provenance.json; exit code 4 where"
        " one differs."
    ),
}
