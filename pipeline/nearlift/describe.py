"""Declarations as Markdown, for `nearlift describe` and the reference pages of the site.

This module only formats; every fact is stated by a declaration.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from nearlift import catalogue
from nearlift.declare import BOUNDARIES, Declaration, Effect, LiftModel
from nearlift.nomenclature import SYMBOLS, Symbol, symbol
from nearlift.run.tables import Product
from nearlift.stages import PRODUCTS


def describe(name: str | None = None) -> str:
    """A model, effect, product or symbol as Markdown; without a name, the catalogue.

    Raises
    ------
    UsageError
        Nothing has that name; the nearest names are proposed.
    """
    if name is None:
        return listing()
    if name.startswith("u_"):
        return symbol_page(symbol(name))
    everything: tuple[Declaration | Product | Symbol, ...] = (
        *catalogue.models(),
        *catalogue.effects(),
        *PRODUCTS,
        *SYMBOLS,
    )
    by_file = {p.file: p for p in PRODUCTS}
    item = by_file.get(name) or catalogue.find(name, everything, "model, effect, product or symbol")
    if isinstance(item, Declaration):
        return declaration(item)
    return product_page(item) if isinstance(item, Product) else symbol_page(item)


def listing() -> str:
    """The catalogue: a line for every model, effect, product and symbol."""
    parts = ["# Catalogue"]
    for boundary in BOUNDARIES:
        models = catalogue.models(boundary)
        rows = [
            (codes([m.name]), m.title, ", ".join(p.name for p in m.parameters) or "nothing")
            for m in models
        ]
        parts += [f"## Models: {boundary}", table(("name", "title", "free"), rows)]
    effects = [(codes([e.name]), e.acts_on, e.mechanism) for e in catalogue.effects()]
    products = [(codes([p.file]), p.title) for p in PRODUCTS]
    return page(
        *parts,
        "## Effects",
        table(("name", "acts on", "mechanism"), effects),
        "## Products",
        table(("file", "holds"), products),
        "## Symbols",
        codes(s.name for s in SYMBOLS),
    )


def declaration(item: Declaration) -> str:
    """One model or effect, with its other forms."""
    facts = [("name", codes([item.name]))]
    if isinstance(item, LiftModel):
        downwash = "yes" if item.downwash else "not modelled"
        facts += [("boundary", item.boundary), ("rotors", item.rotors), ("downwash", downwash)]
    if isinstance(item, Effect):
        facts += [("form", item.form)] if item.form else []
        facts += [
            ("acts on", item.acts_on + (", additive" if item.additive else "")),
            ("mechanism", item.mechanism),
            ("shape varies with", codes([item.varies_with])),
            ("identified by", item.separated_by or "nothing more"),
            ("to be recorded", codes(item.log_next_time) or "nothing more"),
        ]
    low, high = item.valid_z_hat
    upper = "" if math.isinf(high) else f", up to {high:g}"
    facts += [
        ("needs", codes(item.needs) or "nothing"),
        ("valid", f"z_hat above {low:g}{upper}"),
    ]
    parts = [f"# {item.title}", f"$$ {item.formula} $$", table(("", ""), facts), *_numbers(item)]
    for other in item.other_forms if isinstance(item, Effect) else ():
        parts += [f"# {item.title}: {other.form}", f"$$ {other.formula} $$", *_numbers(other)]
    return page(*parts)


def _numbers(item: Declaration) -> tuple[str, ...]:
    """Notes, parameters, source and checks."""
    parameters = [
        (
            codes([p.name]),
            p.unit,
            f"{p.value:.6g}",
            f"{p.bounds[0]:g} to {p.bounds[1]:g}",
            str(p.prior),
            p.meaning,
        )
        for p in item.parameters
    ]
    source = item.source
    equation = f"; equation {source.equation}" if source.equation else ""
    doi = f"; doi {source.doi}" if source.doi else ""
    checks = [
        (f"{c.x:g}", _arguments(c.arguments), f"{c.expected:.7g}", f"{c.tolerance:g}", c.quoted_by)
        for c in item.checks
    ]
    return (
        item.notes.strip(),
        "## Parameters" if parameters else "",
        table(("name", "unit", "value", "bounds", "prior", "meaning"), parameters),
        "## Source",
        f"{source.citation}{equation}{doi}.",
        "Doubts:" if source.doubts else "",
        "\n".join(f"- {doubt}" for doubt in source.doubts),
        "## Checks",
        table(("at", "with", "gives", "within", "quoted by"), checks),
    )


def product_page(product: Product) -> str:
    """One file that a stage writes."""
    columns = [(codes([c.name]), c.kind, c.unit, c.meaning) for c in product.columns]
    return page(
        f"# {product.title}",
        f"`{product.file}`, schema `{product.schema}`. One row or entry: {product.row}.",
        table(("column", "kind", "unit", "meaning"), columns),
        "Further columns may follow." if product.open_ended else "",
    )


def symbol_page(item: Symbol) -> str:
    """One symbol."""
    facts = [
        ("symbol", f"${item.latex}$"),
        ("unit", item.unit or "none"),
        ("in the paper", f"${item.paper_symbol}$" if item.paper_symbol else "not there"),
    ]
    meaning = f"{item.meaning[0].upper()}{item.meaning[1:]}."
    return page(f"# `{item.name}`", meaning, table(("", ""), facts))


def page(*parts: str) -> str:
    """Parts with empty lines between them; empty ones are left out."""
    return "\n\n".join(filter(None, parts)) + "\n"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Table in Markdown; empty without rows."""
    lines = [head, ["---"] * len(head), *rows] if rows else []
    return "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines
    )


def codes(names: Iterable[str]) -> str:
    """Names as code, with commas between them."""
    return ", ".join(f"`{name}`" for name in names)


def _arguments(arguments: Mapping[str, object]) -> str:
    return ", ".join(
        f"{k} = {v:.6g}" if isinstance(v, int | float) else f"{k} given"
        for k, v in arguments.items()
    )
