"""Write docs/reference from the declarations, the command line and the claims.

`make docs` runs it before mkdocs; the pages are not committed.
"""

import tomllib
from pathlib import Path

import click

from nearlift.cli import main as command_line
from nearlift.describe import codes, declaration, page, product_page, table
from nearlift.effects import EFFECTS
from nearlift.models import MODELS
from nearlift.nomenclature import SYMBOLS
from nearlift.stages import PRODUCTS, STAGES

HERE = Path(__file__).parent
ROOT = HERE / "reference"
CLAIMS = HERE.parent / "tests" / "reference" / "claims.toml"


def command_page() -> str:
    """Every command with its help text, as ``--help`` prints it."""
    parts = ["# Command line", _help(command_line, "nearlift")]
    context = click.Context(command_line)
    for name in command_line.list_commands(context):
        command = command_line.get_command(context, name)
        parts += [f"## {name}", _help(command, f"nearlift {name}")]
        for inner, own in command.commands.items() if isinstance(command, click.Group) else ():
            parts += [f"### {name} {inner}", _help(own, f"nearlift {name} {inner}")]
    return "\n\n".join(parts) + "\n"


def _help(command: click.Command, name: str) -> str:
    context = click.Context(
        command,
        info_name=name,
        terminal_width=110,
        max_content_width=110,
        help_option_names=["-h", "--help"],
    )
    return f"```text\n{command.get_help(context)}\n```"


def claims_page() -> str:
    """Numbers stated by Carter, Bouchard and Quinn 2021, each computed again."""
    claims = tomllib.loads(CLAIMS.read_text(encoding="utf-8"))["claim"]
    verdicts = [claim["verdict"] for claim in claims]
    counted = ", ".join(
        f"{verdicts.count(verdict)} {verdict}"
        for verdict in dict.fromkeys(sorted(verdicts, reverse=True))
    )
    lines = [
        "# What the paper states",
        "",
        (
            "Carter, Bouchard and Quinn, *Influence of the Ground, Ceiling, and Sidewall on"
            " Micro-Quadrotors*, AIAA Journal 2021: every number that"
        ),
        (
            "it states, in its order, worked out again by `tests/reference/test_claims.py`. Of"
            f" {len(claims)} claims: {counted}."
        ),
        "",
        "| claim | computed | verdict | why |",
        "| --- | --- | --- | --- |",
    ]
    for claim in claims:
        computed = (
            f"{claim['gives']:.6g} {claim.get('gives_unit', claim.get('unit', '')).removeprefix('1')}".strip()
            if isinstance(claim.get("gives"), int | float)
            else ""
        )
        cells = (claim["text"], computed, claim["verdict"], claim.get("why", ""))
        lines.append(
            "| " + " | ".join(" ".join(cell.replace("|", "\\|").split()) for cell in cells) + " |"
        )
    return "\n".join(lines) + "\n"


def stages_page() -> str:
    """The stages in the order in which they run, with what makes each stale."""
    rows = [
        (
            codes([s.name]),
            s.summary,
            "every product" if s.report else codes(p.file for p in s.reads),
            codes(p.file for p in s.writes),
            codes(s.sections),
            codes(filter(None, [s.where])),
        )
        for s in STAGES
    ]
    text = (
        "A stage runs if its input, its output, one of its sections of the manifest, the seed or"
        " nearlift itself has changed."
    )
    head = ("stage", "", "reads", "writes", "sections of the manifest", "only with")
    return page("# Stages", text, table(head, rows))


def nomenclature_page() -> str:
    """All symbols in one table."""
    rows = [
        (
            codes([s.name]),
            f"${s.latex}$",
            s.unit,
            s.meaning,
            f"${s.paper_symbol}$" if s.paper_symbol else "",
        )
        for s in SYMBOLS
    ]
    return page("# Nomenclature", table(("name", "symbol", "unit", "meaning", "paper"), rows))


def reference_pages() -> dict[str, str]:
    """The generated pages by path under docs/reference; built-in declarations only, so that no
    plug-in alters them.
    """
    pages = {f"models/{m.name}.md": declaration(m) for m in MODELS}
    pages |= {f"effects/{e.name}.md": declaration(e) for e in EFFECTS}
    pages |= {f"products/{p.name}.md": product_page(p) for p in PRODUCTS}
    for folder, title, meaning, items in (
        ("models", "Lift models", "boundary", [(m.name, m.title, m.boundary) for m in MODELS]),
        ("effects", "Effects", "acts on", [(e.name, e.title, e.acts_on) for e in EFFECTS]),
        ("products", "Products", "one row or entry", [(p.name, p.title, p.row) for p in PRODUCTS]),
    ):
        rows = [(f"[`{name}`]({name}.md)", described, third) for name, described, third in items]
        pages[f"{folder}/index.md"] = page(f"# {title}", table(("name", "", meaning), rows))
    return pages | {"nomenclature.md": nomenclature_page(), "stages.md": stages_page()}


def pages() -> dict[str, str]:
    """Text of every page, by its path under docs/reference."""
    return reference_pages() | {"cli.md": command_page(), "claims.md": claims_page()}


def main() -> None:
    """Write every page and remove those without a declaration."""
    found = pages()
    for path in ROOT.rglob("*.md"):
        if path.relative_to(ROOT).as_posix() not in found:
            path.unlink()
    for name, text in found.items():
        path = ROOT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
