"""Texts from templates of prose: methods.md, and forecasts for the console."""

from __future__ import annotations

import functools
import math
import textwrap

import jinja2

from nearlift.catalogue import titled
from nearlift.report import phrases
from nearlift.rounding import plain

#: Columns of a console's text.
WIDTH = 110


@functools.cache
def environment() -> jinja2.Environment:
    """Templates of texts; a name that is not given is an error."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.report.documents", "templates"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,
    )
    made.filters |= {
        "plain": plain,
        "titled": titled,
        "counted": phrases.counted,
        "listed": phrases.listed,
        "several": phrases.several,
        "titles": phrases.titles,
        "sentence": phrases.sentence,
    }
    made.globals |= {"inf": math.inf}
    return made


def console(template: str, **facts: object) -> str:
    """A text for the console: paragraphs wrapped, lines that begin with a space as they are."""
    text = environment().get_template(template).render(**facts).strip("\n")
    lines = [
        line if line.startswith(" ") else textwrap.fill(line, WIDTH) for line in text.splitlines()
    ]
    return "\n".join(lines) + "\n"
