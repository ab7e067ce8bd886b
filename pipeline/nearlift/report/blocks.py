"""Parts of a chapter as HTML: paragraphs, lists, folds and tables.

Values are escaped unless they are HTML themselves; texts are those of the package.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from markupsafe import Markup, escape

from nearlift.report.phrases import typeset


def join(*parts: Markup | str) -> Markup:
    """Parts one below the other; empty ones are left out."""
    return Markup("\n").join(filter(None, parts))


def paragraph(text: str, *values: object, note: bool = False) -> Markup:
    """A paragraph with values in place of ``{}``."""
    kind = Markup(' class="note"') if note else ""
    return Markup("<p{}>{}</p>").format(kind, Markup(text).format(*map(shown, values)))


def shown(value: object) -> Markup:
    """A value as the page has it: HTML as it is, text typeset."""
    return escape(value) if hasattr(value, "__html__") else typeset(str(value))


def bold(text: str) -> Markup:
    """Text that leads a paragraph."""
    return Markup("<strong>{}</strong>").format(typeset(text))


def span(text: str, *values: object) -> Markup:
    """Part of a sentence that keeps to the background, such as an interval."""
    return Markup(' <span class="interval">({})</span>').format(Markup(text).format(*values))


def note(text: str) -> Markup:
    """Remark within a cell."""
    return Markup(' <em class="note">{}</em>').format(text)


def heading(text: str) -> Markup:
    """Heading within a chapter."""
    return Markup("<h4>{}</h4>").format(text)


def items(lines: Iterable[object], kind: str = "notes") -> Markup:
    """List of sentences; empty without any."""
    text = Markup("").join(Markup("<li>{}</li>").format(shown(line)) for line in lines)
    return Markup('<ul class="{}">{}</ul>').format(kind, text) if text else Markup("")


def fold(summary: object, *parts: Markup | str, opened: bool = False) -> Markup:
    """Parts behind a summary, folded unless `opened`; empty without parts."""
    within = join(*parts)
    state = Markup(" open") if opened else ""
    text = Markup("<details{}><summary>{}</summary>\n{}</details>")
    return text.format(state, shown(summary), within) if within else within


def table(
    caption: object,
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    hidden: bool = False,
    source: str = "",
) -> Markup:
    """Table of rows of cells; empty without rows. In a short row the last cell extends over the
    columns that are missing. A `hidden` caption is for screen readers; `source` is the product of
    all cells. A last column without content is left out.
    """
    cells = [[shown(cell) for cell in row] for row in rows]
    if not cells:
        return Markup("")
    if all(len(row) == len(heads) and not row[-1] for row in cells):
        heads, cells = heads[:-1], [row[:-1] for row in cells]
    lines = [_row(row, len(heads)) for row in cells]
    kind = Markup(' class="hidden"') if hidden else ""
    of = Markup(' data-source="{}"').format(source) if source else ""
    columns = Markup("").join(Markup('<th scope="col">{}</th>').format(shown(h)) for h in heads)
    wide = Markup(' tabindex="0" role="group" aria-label="{}"').format(shown(caption).striptags())
    return Markup(
        '<div class="wide"{}><table><caption{}>{}</caption><thead><tr>{}</tr></thead>'
        "<tbody{}>{}</tbody></table></div>"
    ).format(wide, kind, shown(caption), columns, of, Markup("\n").join(lines))


def _row(row: Sequence[Markup], n: int) -> Markup:
    first, *cells = row
    wide = Markup(' colspan="{}"').format(n - len(cells)) if cells and len(cells) < n - 1 else ""
    spans = ["" for _ in cells[:-1]] + [wide]
    text = Markup("").join(
        Markup("<td{}>{}</td>").format(s, c) for s, c in zip(spans, cells, strict=False)
    )
    return Markup('<tr><th scope="row">{}</th>{}</tr>').format(first, text)


def figure(name: str) -> Markup:
    """Place of a figure."""
    return Markup(f"<!--figure {name}-->")
