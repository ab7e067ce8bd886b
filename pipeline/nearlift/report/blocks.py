"""Parts of a chapter as HTML: paragraphs, lists, folds and tables, numbers with their sources.

Values are escaped unless they are HTML themselves; texts are those of the package.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd
from markupsafe import Markup

from nearlift.report import tables


def join(*parts: Markup | str) -> Markup:
    """Parts one below the other; empty ones are left out."""
    return Markup("\n").join(filter(None, parts))


def paragraph(text: str, *values: object, note: bool = False) -> Markup:
    """A paragraph with values in place of ``{}``."""
    kind = Markup(' class="note"') if note else ""
    return Markup("<p{}>{}</p>").format(kind, Markup(text).format(*values))


def bold(text: str) -> Markup:
    """Text that leads a paragraph."""
    return Markup("<strong>{}</strong>").format(tables.typeset(text))


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
    text = Markup("").join(Markup("<li>{}</li>").format(line) for line in lines)
    return Markup('<ul class="{}">{}</ul>').format(kind, text) if text else Markup("")


def fold(summary: object, *parts: Markup | str, opened: bool = False) -> Markup:
    """Parts behind a summary, folded unless `opened`."""
    state = Markup(" open") if opened else ""
    text = "<details{}><summary>{}</summary>\n{}</details>"
    return Markup(text).format(state, summary, join(*parts))


def table(
    caption: object,
    heads: Sequence[str],
    rows: Sequence[Sequence[object]],
    hidden: bool = False,
    source: str = "",
) -> Markup:
    """Table of rows of cells; empty without rows. In a short row the last cell extends over the
    columns that are missing. The caption is `hidden` where a summary says it;
    `source` is the product of all cells.
    """
    if not rows:
        return Markup("")
    frame = pd.DataFrame(
        [tables.spread(row, len(heads)) for row in rows],
        columns=[*map(str, range(len(heads)))],
        dtype=object,
    )
    shown = dict(zip(map(str, range(len(heads))), heads, strict=True))
    whole = tables.Table(caption="", frame=frame, shown=shown)
    text = tables.html(whole, Markup("{}").format(caption), hidden)
    body = Markup('<tbody data-source="{}">').format(source)
    return text.replace(Markup("<tbody>"), body) if source else text


def figure(name: str) -> Markup:
    """Place of a figure."""
    return Markup(f"<!--figure {name}-->")


def copies(name: str) -> Markup:
    """Button that copies the text of an element, shown where the page's script runs."""
    return Markup('<button type="button" data-copies="{}" hidden>Copy</button>').format(name)
