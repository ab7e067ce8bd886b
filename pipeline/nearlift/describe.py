"""Declarations as Markdown, for `nearlift describe` and for the reference pages of the site.

This module only formats; every fact is stated by a declaration.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from nearlift import catalogue
from nearlift.declare import BOUNDARIES, Declaration, Effect, LiftModel
from nearlift.effects import EFFECTS
from nearlift.models import MODELS
from nearlift.nomenclature import SYMBOLS, Symbol, symbol
from nearlift.run.tables import Product
from nearlift.stages import PRODUCTS, STAGES


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
            (_codes([m.name]), m.title, ", ".join(p.name for p in m.parameters) or "nothing")
            for m in models
        ]
        parts += [f"## Models: {boundary}", _table(("name", "title", "free"), rows)]
    effects = [(_codes([e.name]), e.acts_on, e.mechanism) for e in catalogue.effects()]
    products = [(_codes([p.file]), p.title) for p in PRODUCTS]
    return _page(
        *parts,
        "## Effects",
        _table(("name", "acts on", "mechanism"), effects),
        "## Products",
        _table(("file", "holds"), products),
        "## Symbols",
        _codes(s.name for s in SYMBOLS),
    )


def declaration(item: Declaration) -> str:
    """One model or effect, with its other forms."""
    facts = [("name", _codes([item.name]))]
    if isinstance(item, LiftModel):
        downwash = "yes" if item.downwash else "not modelled"
        facts += [("boundary", item.boundary), ("rotors", item.rotors), ("downwash", downwash)]
    if isinstance(item, Effect):
        facts += [("form", item.form)] if item.form else []
        facts += [
            ("acts on", item.acts_on + (", additive" if item.additive else "")),
            ("mechanism", item.mechanism),
            ("shape varies with", _codes([item.varies_with])),
            ("identified by", item.separated_by or "nothing more"),
            ("to be recorded", _codes(item.log_next_time) or "nothing more"),
        ]
    low, high = item.valid_z_hat
    upper = "" if math.isinf(high) else f", up to {high:g}"
    facts += [
        ("needs", _codes(item.needs) or "nothing"),
        ("valid", f"z_hat above {low:g}{upper}"),
    ]
    parts = [f"# {item.title}", f"$$ {item.formula} $$", _table(("", ""), facts), *_numbers(item)]
    for other in item.other_forms if isinstance(item, Effect) else ():
        parts += [f"# {item.title}: {other.form}", f"$$ {other.formula} $$", *_numbers(other)]
    return _page(*parts)


def _numbers(item: Declaration) -> tuple[str, ...]:
    """Notes, parameters, source and checks."""
    parameters = [
        (
            _codes([p.name]),
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
        _table(("name", "unit", "value", "bounds", "prior", "meaning"), parameters),
        "## Source",
        f"{source.citation}{equation}{doi}.",
        "Doubts:" if source.doubts else "",
        "\n".join(f"- {doubt}" for doubt in source.doubts),
        "## Checks",
        _table(("at", "with", "gives", "within", "quoted by"), checks),
    )


def product_page(product: Product) -> str:
    """One file that a stage writes."""
    columns = [(_codes([c.name]), c.kind, c.unit, c.meaning) for c in product.columns]
    return _page(
        f"# {product.title}",
        f"`{product.file}`, schema `{product.schema}`. One row or entry: {product.row}.",
        _table(("column", "kind", "unit", "meaning"), columns),
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
    return _page(f"# `{item.name}`", meaning, _table(("", ""), facts))


def stages_page() -> str:
    """The stages in the order in which they run, with what makes each stale."""
    rows = [
        (
            _codes([s.name]),
            s.summary,
            "every product" if s.report else _codes(p.file for p in s.reads),
            _codes(p.file for p in s.writes),
            _codes(s.sections),
            _codes(filter(None, [s.where])),
        )
        for s in STAGES
    ]
    text = (
        "A stage runs if its input, its output, one of its sections of the manifest, the seed or"
        " nearlift itself has changed."
    )
    head = ("stage", "", "reads", "writes", "sections of the manifest", "only with")
    return _page("# Stages", text, _table(head, rows))


def nomenclature_page() -> str:
    """All symbols in one table."""
    rows = [
        (
            _codes([s.name]),
            f"${s.latex}$",
            s.unit,
            s.meaning,
            f"${s.paper_symbol}$" if s.paper_symbol else "",
        )
        for s in SYMBOLS
    ]
    return _page("# Nomenclature", _table(("name", "symbol", "unit", "meaning", "paper"), rows))


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
        pages[f"{folder}/index.md"] = _page(f"# {title}", _table(("name", "", meaning), rows))
    return pages | {"nomenclature.md": nomenclature_page(), "stages.md": stages_page()}


def _page(*parts: str) -> str:
    """Parts with empty lines between them; empty ones are left out."""
    return "\n\n".join(filter(None, parts)) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Table in Markdown; empty without rows."""
    lines = [head, ["---"] * len(head), *rows] if rows else []
    return "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines
    )


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _arguments(arguments: Mapping[str, object]) -> str:
    return ", ".join(
        f"{k} = {v:.6g}" if isinstance(v, int | float) else f"{k} given"
        for k, v in arguments.items()
    )
