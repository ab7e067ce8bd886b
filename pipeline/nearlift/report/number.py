"""Numbers of the page, each with its product and key."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup, escape

from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import LEAST_P, is_even, raised, typeset
from nearlift.rounding import fixed, like, plain
from nearlift.run.tables import Product
from nearlift.stages.fit import RESULTS

#: Fewer degrees of freedom than this are printed with a decimal.
MIN_INTEGER_DOF = 9.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """One number of the page.

    Attributes
    ----------
    text : str
        As printed.
    value : float
        In full.
    source : str
        Product and key: ``fit.json#/boundaries/ground/...`` is a JSON pointer, ``trials.parquet`` a
        table.
    how : str
        Operation on that number; empty if nothing but rounding.
    """

    text: str
    value: float
    source: str
    how: str = ""

    def __html__(self) -> Markup:
        """The number with its source; the text alone where it has no value."""
        if not math.isfinite(self.value):
            return escape(self.text)
        how = Markup(' data-how="{}"').format(self.how) if self.how else ""
        return Markup('<data value="{}" data-source="{}"{}>{}</data>').format(
            repr(self.value), self.source, how, raised(self.text)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Quoted:
    """An estimate as printed: value, standard uncertainty and 90 % interval, all with the same
    decimals; without `u` where ± would not describe the interval.
    """

    name: str
    unit: str
    value: Number
    u: Number | None
    interval: Markup
    at_bound: bool

    @property
    def symbol(self) -> Markup:
        """Letter with its index."""
        head, _, sub = letter(self.name).partition("_")
        index = Markup("<sub>{}</sub>").format(sub) if sub else ""
        return Markup("<i>{}</i>{}").format(head, index)

    @property
    def estimate(self) -> Markup:
        """Value, ± where it describes the interval, and unit."""
        u = Markup(" ± {}").format(self.u) if self.u else ""
        unit = f" {self.unit}" if self.unit else ""
        bound = Markup(' <em class="note">at its bound</em>') if self.at_bound else ""
        return Markup("{}{}{}{}").format(self.value, u, unit, bound)

    @property
    def equation(self) -> Markup:
        """``K_b = 2.06 ± 0.08``."""
        return Markup("{} = {}").format(self.symbol, self.estimate)

    def __html__(self) -> Markup:
        """``K_b = 2.06 ± 0.08 (90 %: 1.93 to 2.19)``."""
        text = Markup('{} <span class="interval">(90 %: {})</span>')
        return text.format(self.equation, self.interval)


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a JSON product; the numbers below it are cited by their paths from there."""

    evidence: Evidence
    product: Product
    path: tuple[str | int, ...] = ()

    def at(self, *path: str | int) -> Place:
        """A place below this one."""
        return Place(self.evidence, self.product, (*self.path, *path))

    def every(self, *path: str | int) -> list[Place]:
        """The places of all entries below one, a list or an object, in order."""
        place = self.at(*path)
        within = place.content or ()
        return [place.at(k) for k in (range(len(within)) if isinstance(within, list) else within)]

    @property
    def title(self) -> str:
        """The last key of its path, with a capital."""
        return str(self.path[-1]).capitalize()

    @property
    def content(self) -> Any:
        """Content of the place; None where there is nothing."""
        content: Any = self.evidence.document(self.product)
        for key in self.path:
            if isinstance(content, Mapping):
                content = content.get(key)
            elif isinstance(content, list) and isinstance(key, int) and key < len(content):
                content = content[key]
            else:
                return None
        return content

    def source(self, *path: str | int) -> str:
        """Product and JSON pointer (RFC 6901)."""
        keys = (str(p).replace("~", "~0").replace("/", "~1") for p in (*self.path, *path))
        return f"{self.product.file}#{''.join(f'/{key}' for key in keys)}"

    def number(
        self,
        *path: str | int,
        digits: int = 4,
        scale: float = 1.0,
        show: Callable[[float], float] | None = None,
        how: str = "",
        like_u: float | None = None,
        places: int | None = None,
    ) -> Number:
        """One number, scaled or as `show` makes it: to so many digits, or so many decimal places,
        or those of an uncertainty `like_u`.
        """
        content = self.at(*path).content
        value = math.nan if content is None else float(content)
        shown = show(value) if show else scale * value
        if not math.isfinite(value):
            text = "–"
        elif places is not None:
            text = fixed(shown, places)
        else:
            text = plain(shown, digits) if like_u is None else like(shown, like_u)
        return Number(text=text, value=value, source=self.source(*path), how=how)

    def percent(
        self, *path: str | int, digits: int = 4, places: int | None = None, how: str = "in percent"
    ) -> Number:
        """A fraction in percent."""
        return self.number(*path, digits=digits, places=places, scale=100, how=how)

    def ends(self, *path: str | int, **kwargs: Any) -> Markup:
        """Ends of a 90 % interval."""
        low, high = (self.number(*path, end, **kwargs) for end in ("lo90", "hi90"))
        return Markup("{} to {}").format(low, high)

    def quote(
        self,
        *path: str | int,
        name: str = "",
        show: Callable[[float], float] = float,
        unit: str | None = None,
    ) -> Quoted:
        """An estimate from an object with `value`, `lo90`, `hi90` and perhaps `u`, `unit`,
        `at_bound`.

        It is an estimate of the path's last key, or of `name`. `show` converts its numbers into
        `unit`.
        """
        place = self.at(*path)
        entry = place.content
        known = {k: show(v) for k, v in entry.items() if isinstance(v, int | float)}
        # an interval without `u` still says to how many digits its centre is known
        width = known.get("hi90", math.nan) - known.get("lo90", math.nan)
        u = (known.get("u", 0.0) if show is float else 0.0) or width / 3.3
        u = u if math.isfinite(u) and u > 0 else abs(known["value"] or 1.0) * 1e-4
        how = "" if show is float else "in other units"
        if unit is None:
            unit = "" if entry.get("unit", "1") == "1" else entry["unit"]
        return Quoted(
            name=name or str(place.path[-1]),
            unit=unit,
            value=place.number("value", like_u=u, show=show, how=how),
            u=place.number("u", like_u=u) if "u" in known else None,
            interval=place.ends(like_u=u, show=show, how=how),
            at_bound=bool(entry.get("at_bound")),
        )

    def chance(self, *path: str | int) -> Number:
        """A p-value; below what any test here can mean, only its bound."""
        p = self.number(*path, digits=2)
        if p.value < LEAST_P:
            return replace(p, text="< 10⁻¹²", how="a bound")
        return p

    def degrees(self, *path: str | int) -> Number:
        """Degrees of freedom: one decimal below ten, where it matters; ∞ where they have no end."""
        dof = self.number(*path, places=0)
        if not math.isfinite(dof.value):
            return replace(dof, text="∞", value=math.inf)
        return dof if dof.value >= MIN_INTEGER_DOF else replace(dof, text=fixed(dof.value, 1))

    def text(self, *path: str | int) -> Markup:
        """A sentence of the product behind the boundary that it is about."""
        return Markup("<strong>{}.</strong> {}").format(self.title, typeset(self.at(*path).content))


def count(product: Product, value: int, how: str) -> Number:
    """A number of rows of a table product."""
    return Number(text=str(value), value=float(value), source=product.file, how=how)


def headline(evidence: Evidence, boundary: Boundary, name: str) -> Quoted:
    """A coefficient as it is to be quoted."""
    quoted = quotation(evidence, boundary, name).quote(name=name)
    even = is_even(evidence.quoted(boundary).coefficients[name])
    return quoted if even else replace(quoted, u=None)


def quotation(evidence: Evidence, boundary: Boundary, name: str) -> Place:
    """Place at which results.json quotes a coefficient."""
    return Place(evidence, RESULTS, ("boundaries", boundary, "coefficients", name))
