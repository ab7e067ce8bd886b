"""Draw docs/architecture.svg: the packages of the package by layer, and who imports whom.

An arrow that follows from others is left out: it would only say that an import of an import may be
imported too. So is one to what is below the declarations, which every package may use.
"""

from __future__ import annotations

import ast
import html
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pipeline" / "nearlift"
FILE = ROOT / "docs" / "architecture.svg"
WIDTH, ROW, BOX, LETTER, GAP = 960, 58, 26, 7.6, 18
STYLE = (
    "text{font:13px ui-monospace,monospace;fill:#222;text-anchor:middle}"
    "rect{fill:#f4f4f0;stroke:#666}.core{fill:#e3edf7}path{fill:none;stroke:#8a8a8a}"
    "@media(prefers-color-scheme:dark){text{fill:#eee}rect{fill:#333}.core{fill:#26405c}}"
)


def layers() -> list[list[str]]:
    """Packages by layer of pyproject.toml, each in the highest that names it or a part of it."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = next(c for c in settings["tool"]["importlinter"]["contracts"] if "layers" in c)
    seen: dict[str, None] = {}
    rows = []
    for layer in contract["layers"]:
        parts = [part.strip().split(".")[0] for part in layer.replace(":", "|").split("|")]
        fresh = [package for package in dict.fromkeys(parts) if package not in seen]
        seen |= dict.fromkeys(fresh)
        rows.append(fresh)
    return [row for row in rows if row]


def imports() -> dict[str, set[str]]:
    """Packages that each package imports, wherever in a module."""
    packages = {package for row in layers() for package in row}
    found: dict[str, set[str]] = {package: set() for package in packages}
    for path in sorted(PACKAGE.rglob("*.py")):
        package = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if package not in packages:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            parts = [name.split(".") for name in names]
            found[package] |= {p[1] for p in parts if p[0] == "nearlift" and len(p) > 1} & packages
    order = {package: i for i, row in enumerate(layers()) for package in row}
    return {a: {b for b in used if order[b] > order[a]} for a, used in found.items()}


def direct(edges: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Imports that do not follow from others, down to the declarations."""
    rows = layers()
    base = {
        package
        for row in rows[next(i for i, r in enumerate(rows) if "declare" in r) + 1 :]
        for package in row
    }
    below: dict[str, set[str]] = {}
    for row in reversed(layers()):
        for package in row:
            below[package] = edges[package].union(*(below[b] for b in edges[package]))
    return sorted(
        (a, b)
        for a, used in edges.items()
        for b in used - base
        if all(b not in below[c] for c in used)
    )


def picture() -> str:
    """The SVG."""
    rows = layers()
    loop = next(i for i, row in enumerate(rows) if "loop" in row)
    place: dict[str, tuple[float, float, float]] = {}
    for i, row in enumerate(rows):
        widths = [len(package) * LETTER + 20 for package in row]
        x = (WIDTH - sum(widths) - GAP * (len(row) - 1)) / 2
        # a package alone in its row is set aside of the one above, or its arrows would hide behind it
        x += (0, -170, 170)[i % 3] if len(row) == 1 else 0
        for package, width in zip(row, widths, strict=True):
            place[package] = (x, 12.0 + i * ROW, width)
            x += width + GAP
    parts = []
    for a, b in direct(imports()):
        (xa, ya, wa), (xb, yb, wb) = place[a], place[b]
        start, end = (xa + wa / 2, ya + BOX), (xb + wb / 2, yb)
        middle = (start[1] + end[1]) / 2
        parts.append(
            f'<path marker-end="url(#head)" d="M{start[0]:.0f} {start[1]:.0f}C{start[0]:.0f}'
            f' {middle:.0f} {end[0]:.0f} {middle:.0f} {end[0]:.0f} {end[1] - 4:.0f}"/>'
        )
    for i, row in enumerate(rows):
        for package in row:
            x, y, width = place[package]
            kind = ' class="core"' if i >= loop else ""
            parts.append(
                f'<rect{kind} x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{BOX}" rx="4"/>'
                f'<text x="{x + width / 2:.0f}" y="{y + 17:.0f}">{html.escape(package)}</text>'
            )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {12 + len(rows) * ROW}"'
        ' role="img" aria-label="Packages of nearlift by layer, and their imports">\n'
        f"<style>{STYLE}</style>\n"
        '<defs><marker id="head" markerWidth="7" markerHeight="7" refX="5" refY="3"'
        ' orient="auto"><path d="M0 0L6 3L0 6"/></marker></defs>\n'
        + "\n".join(parts)
        + "\n</svg>\n"
    )


if __name__ == "__main__":
    FILE.write_text(picture(), encoding="utf-8")
