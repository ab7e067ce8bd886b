"""history: the runs of a campaign that are kept."""

from __future__ import annotations

from pathlib import Path

from nearlift.commands.common import CAMPAIGN, Call, declared


@declared("history")
@CAMPAIGN
def command(call: Call, campaign: Path) -> None:
    """Each run with its headlines, the newest first."""
    from nearlift.run import history
    from nearlift.run.lock import settled
    from nearlift.run.transaction import Homes

    path = campaign / history.MANIFEST
    homes = Homes.within(call.out, history.name_of(path))
    settled(homes)
    present = path.read_bytes()
    content, text = [], []
    for folder in history.folders(homes):
        run = history.read(folder)
        if run is None:
            content.append({"folder": str(folder), "damaged": True})
            text.append(f"{folder.name}  damaged: not what was kept")
            continue
        same = run.manifest == present
        content.append(
            {
                "folder": str(folder),
                "damaged": False,
                "time": run.time.isoformat(timespec="milliseconds"),
                "digest": run.digest,
                "present_manifest": same,
                "headlines": run.headlines,
            }
        )
        first, *more = run.headlines or ("no boundary",)
        start = f"{run.time:%Y-%m-%d %H:%M:%S}Z  {run.digest}  "
        mark = "  (the present manifest)" if same else ""
        text += [start + first + mark, *(" " * len(start) + line for line in more)]
    call.answer(content, "\n".join(text) or f"no run of {homes.processed.name} is kept yet")
