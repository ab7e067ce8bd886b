"""data: public measured data, listed and fetched."""

from __future__ import annotations

from pathlib import Path

import click

from nearlift.commands import ABOUT, common
from nearlift.commands.common import Call

REGISTRY = click.option(
    "--registry",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Another list of data sets, in the form of nearlift's own.",
)


@click.group("data", help=ABOUT["data"].page, epilog=ABOUT["data"].epilog)
def command() -> None:
    """Two commands."""


@REGISTRY
def _list(call: Call, registry: Path | None) -> None:
    from nearlift.datasets.registry import OWN, datasets
    from nearlift.rounding import bytes_text

    listed = datasets(registry or OWN)
    lines = []
    for item in listed:
        held = (
            "size unknown"
            if any(f.bytes is None for f in item.file)
            else bytes_text(sum(f.bytes or 0 for f in item.file))
        )
        files = f"{len(item.file)} file{'s' if len(item.file) > 1 else ''}, {held}"
        unchecked = "its digest is not known: wants --trust" if item.unknown else ""
        about = (
            item.title,
            f"{files}; licence: {item.licence}",
            item.citation,
            item.note,
            unchecked,
        )
        lines += [item.name, *(f"  {line}" for line in about if line)]
    call.answer([item.model_dump() for item in listed], "\n".join(lines))


@click.argument("name")
@click.argument("folder", type=click.Path(path_type=Path), required=False, metavar="[DIR]")
@click.option("--trust", is_flag=True, help="Take files without a known digest.")
@click.option(
    "--cache",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where fetched files are kept [default: NEARLIFT_CACHE, or the system's].",
)
@REGISTRY
def _get(
    call: Call,
    name: str,
    folder: Path | None,
    trust: bool,
    cache: Path | None,
    registry: Path | None,
) -> None:
    from nearlift.datasets.fetch import get
    from nearlift.datasets.registry import OWN, dataset

    wanted = dataset(name, registry or OWN)
    made = get(wanted, folder or Path("raw") / name, trust=trust, cache=cache, say=call.line)
    content = {
        "campaign": str(made),
        "licence": wanted.licence,
        "citation": wanted.citation,
        "next": f"{wanted.next} {made}",
    }
    call.answer(
        content,
        f"{made}\nlicence: {wanted.licence}; cite: {wanted.citation}\nnext: {wanted.next} {made}",
    )


command.add_command(common.command(_list, "list", ABOUT["data list"]))
command.add_command(common.command(_get, "get", ABOUT["data get"]))
