"""demo: a simulated campaign, written and run."""

from __future__ import annotations

from nearlift.commands.common import Call, declared
from nearlift.commands.stage import execute


@declared("demo")
def command(call: Call) -> None:
    """Write the campaign, then run it."""
    from nearlift.synthetic.demo import write_demo

    folder = call.out / "demo-campaign"
    with call.busy("nearlift: simulating the demo's records"):
        write_demo(folder)
    call.line(f"simulated campaign in {folder}")
    execute(call, folder)
