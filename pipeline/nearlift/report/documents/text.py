"""Texts from templates of prose: methods.md, and forecasts for the console."""

from __future__ import annotations

import functools
import math
import textwrap

import jinja2

from nearlift.catalogue import titled
from nearlift.report import phrases
from nearlift.results.estimate import Noise
from nearlift.rounding import plain

#: Displayed units of sizes that are small in SI.
SHOWN = {"m": ("mm", 1e3), "N": ("mN", 1e3), "N/K": ("mN/K", 1e3), "N/m": ("mN/m", 1e3)}
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
        "size": size_text,
        "scatter": _scatter,
    }
    made.globals |= {"inf": math.inf}
    return made


def size_text(value: float, unit: str) -> str:
    """A size with its unit, in millimetres and millinewtons where these are handier."""
    shown, factor = SHOWN.get(unit, ("" if unit == "1" else unit, 1.0))
    return f"{factor * value:.3g} {shown}".strip()


def _scatter(noise: Noise) -> str:
    """Scatter of trials."""
    force_mN, height_mm = 1e3 * noise.force_N, 1e3 * noise.height_m
    return f"{100 * noise.relative:.2g} % of lift, {force_mN:.2g} mN, {height_mm:.2g} mm"


def console(template: str, **facts: object) -> str:
    """A text for the console: paragraphs wrapped, lines that begin with a space as they are."""
    text = environment().get_template(template).render(**facts).strip("\n")
    lines = [
        line
        if line.startswith(" ")
        else textwrap.fill(line, WIDTH, break_long_words=False, break_on_hyphens=False)
        for line in text.splitlines()
    ]
    return "\n".join(lines) + "\n"
