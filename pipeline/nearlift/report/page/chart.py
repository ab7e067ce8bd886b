"""An interactive chart as data: views side by side, native controls bound to their signals, and a
table of what can be pointed at.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from nearlift.report.evidence import Columns

Spec = dict[str, Any]
#: Significant digits of what is drawn: a screen shows fewer.
DIGITS = 6
#: Colours are properties of the page's style sheet, so that a chart follows the reader's scheme.
SERIES = tuple(f"var(--s{i})" for i in range(6))
SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross")
#: In the order of `SHAPES`: where points fall on one another, each next one is smaller, so that all
#: can be seen.
AREAS = (90, 70, 58, 46, 36, 30)
DASHES = ((6, 3), (2, 2), (8, 3, 2, 3), (4, 4), (10, 4), (1, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One of a control's values, with the mark that stands for it in the chart."""

    value: str
    label: str
    on: bool = True
    colour: str = ""
    shape: str = ""
    dash: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """A group of native inputs that sets one signal: to the list of what is ticked, to the one
    chosen, or to true or false.

    `folded` controls stand behind a summary.
    """

    signal: str
    legend: str
    choices: tuple[Choice, ...]
    kind: Literal["several", "one", "switch"] = "several"
    folded: bool = False


def one_of(signal: str, legend: str, labels: Mapping[str, str]) -> Control:
    """A control that sets its signal to one of these values; the first is chosen at first."""
    choices = (Choice(value=v, label=t, on=i == 0) for i, (v, t) in enumerate(labels.items()))
    return Control(signal=signal, legend=legend, kind="one", choices=tuple(choices))


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One drawing.

    Attributes
    ----------
    name, title : str
    spec : dict
        A text in it that begins with ``$`` stands for the value of the control of that signal, or
        for what `follows` from one.
    data : dict of str to Columns
    controls : tuple of Control
        Those that concern this view alone.
    follows : dict
        By signal and its value: what further names then stand for, such as an axis' title.
    """

    name: str
    title: str
    spec: Spec
    data: dict[str, Columns]
    controls: tuple[Control, ...] = ()
    follows: dict[str, dict[str, dict[str, object]]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Interactive form of the figure of the same name, with its description.

    Attributes
    ----------
    name : str
    label : str
        What it is, in a few words.
    views : tuple of View
    controls : tuple of Control
        Those that concern all views.
    across, among : str
        Marks that the left and right, and the up and down arrow keys go along, by what the marks
        are called.
    down : bool
        Whether the marks stand below one another, and the keys go along them so.
    """

    name: str
    label: str
    views: tuple[View, ...]
    controls: tuple[Control, ...] = ()
    across: str = "cell"
    among: str = "cell"
    down: bool = False


def embedded(charts: Sequence[Chart]) -> str:
    """All specifications and data as JSON that can stand in a page: nothing in it ends a script or
    begins a comment.
    """
    content = {
        c.name: {
            v.name: {
                "spec": v.spec,
                "follows": v.follows,
                "data": {n: _columns(d) for n, d in v.data.items()},
            }
            for v in c.views
        }
        for c in charts
    }
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _columns(table: Columns) -> dict[str, object]:
    return {name: _short([_value(v) for v in values.tolist()]) for name, values in table.items()}


def _short(values: list[Any]) -> Any:
    """A column of few values as those values, and which of them each row has."""
    keys = [json.dumps(v) for v in values]
    index = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    at = [index[key] for key in keys]
    worth = sum(map(len, index)) + len(json.dumps(at, separators=(",", ":"))) < sum(map(len, keys))
    return {"of": [json.loads(key) for key in index], "at": at} if worth else values


def _value(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def column(values: Sequence[Any]) -> Any:
    """A column of whatever it is."""
    kept = np.empty(len(values), dtype=object)
    kept[:] = list(values)
    return kept


def shade(i: int, n: int) -> str:
    """The colour of one of `n` values on a ramp."""
    return f"color-mix(in oklab, var(--ramp0), var(--ramp1) {100 * i / max(n - 1, 1):.0f}%)"


def tooltip(fields: Iterable[tuple[str, str]]) -> list[Spec]:
    """Tooltip of a mark: fields by their titles."""
    return [{"field": name, "type": "nominal", "title": title} for name, title in fields]


def frame(description: str, *, height: int, layers: list[Spec], **signals: Any) -> Spec:
    """A specification as wide as its place, in the page's own colours; `signals` by name with their
    first values.
    """
    ink, rule = "var(--text)", "var(--rule)"
    return {
        "description": description,
        "width": "container",
        "height": height,
        "background": None,
        "autosize": {"type": "fit-x", "contains": "padding"},
        "padding": 4,
        "params": [{"name": name, "value": value} for name, value in signals.items()],
        "layer": layers,
        "config": {
            "font": "system-ui, sans-serif",
            "view": {"stroke": rule},
            "axis": {
                "labelColor": ink,
                "titleColor": ink,
                "domainColor": rule,
                "tickColor": rule,
                "gridColor": rule,
                "gridOpacity": 0.35,
                "labelFontSize": 12,
                "titleFontSize": 13,
                "titleFontWeight": "normal",
                "tickCount": 6,
            },
        },
    }


def layer(data: str, transform: list[Spec], mark: Spec, **encoding: Any) -> Spec:
    """One layer of a drawing: the marks of a view's data."""
    return {"data": {"name": data}, "transform": transform, "mark": mark, "encoding": encoding}
