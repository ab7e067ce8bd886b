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
        rows = [
            (f"`{m.name}`", m.title, ", ".join(p.name for p in m.parameters) or "nothing")
            for m in catalogue.models(boundary)
        ]
        parts += [f"## Models: {boundary}", _table(("name", "title", "free"), rows)]
    if catalogue.effects():
        rows = [(f"`{e.name}`", e.acts_on, e.mechanism) for e in catalogue.effects()]
        parts += ["## Effects", _table(("name", "acts on", "mechanism"), rows)]
    parts += [
        "## Products",
        _table(("file", "holds"), [(f"`{p.file}`", p.title) for p in PRODUCTS]),
    ]
    parts += ["## Symbols", ", ".join(f"`{s.name}`" for s in SYMBOLS)]
    return _page(parts)


def declaration(item: Declaration) -> str:
    """One model or effect."""
    facts = [("name", f"`{item.name}`")]
    if isinstance(item, LiftModel):
        facts += [
            ("boundary", item.boundary),
            ("rotors", item.rotors),
            ("downwash", "yes" if item.downwash else "not modelled"),
        ]
    if isinstance(item, Effect):
        acts_on = item.acts_on + (", additive" if item.additive else "")
        recorded = ", ".join(f"`{n}`" for n in item.log_next_time) or "nothing more"
        facts += [
            ("acts on", acts_on),
            ("mechanism", item.mechanism),
            ("shape varies with", f"`{item.varies_with}`"),
            ("identified by", item.separated_by or "nothing more"),
            ("to be recorded", recorded),
        ]
    facts += [
        ("needs", ", ".join(f"`{n}`" for n in item.needs) or "nothing"),
        ("valid", _range(item.valid_z_hat)),
    ]
    parts = [f"# {item.title}", f"$$ {item.formula} $$", _table(("", ""), facts)]
    if item.notes:
        parts += [item.notes.strip()]
    if item.parameters:
        rows = [
            (
                f"`{p.name}`",
                p.unit,
                f"{p.value:.6g}",
                f"{p.bounds[0]:g} to {p.bounds[1]:g}",
                str(p.prior),
                p.meaning,
            )
            for p in item.parameters
        ]
        parts += [
            "## Parameters",
            _table(("name", "unit", "value", "bounds", "prior", "meaning"), rows),
        ]
    source = item.source
    cited = [
        source.citation,
        f"equation {source.equation}" if source.equation else "",
        f"doi {source.doi}" if source.doi else "",
    ]
    parts += ["## Source", "; ".join(c for c in cited if c) + "."]
    if source.doubts:
        parts += ["Doubts:", "\n".join(f"- {d}" for d in source.doubts)]
    checks = [
        (f"{c.x:g}", _arguments(c.arguments), f"{c.expected:.7g}", f"{c.tolerance:g}", c.quoted_by)
        for c in item.checks
    ]
    parts += ["## Checks", _table(("at", "with", "gives", "within", "quoted by"), checks)]
    return _page(parts)


def product_page(product: Product) -> str:
    """One file that a stage writes."""
    parts = [
        f"# {product.title}",
        f"`{product.file}`, schema `{product.schema}`. One row or entry: {product.row}.",
    ]
    if product.columns:
        rows = [(f"`{c.name}`", c.kind, c.unit, c.meaning) for c in product.columns]
        parts += [_table(("column", "kind", "unit", "meaning"), rows)]
    if product.open_ended:
        parts += ["Further columns may follow."]
    return _page(parts)


def symbol_page(item: Symbol) -> str:
    """One symbol."""
    facts = [
        ("symbol", f"${item.latex}$"),
        ("unit", item.unit or "none"),
        ("in the paper", f"${item.paper_symbol}$" if item.paper_symbol else "not there"),
    ]
    return _page(
        [
            f"# `{item.name}`",
            f"{item.meaning[0].upper()}{item.meaning[1:]}.",
            _table(("", ""), facts),
        ]
    )


def stages_page() -> str:
    """The stages in the order in which they run, with what makes each stale."""
    rows = [
        (
            f"`{s.name}`",
            s.summary,
            "every product" if s.report else ", ".join(f"`{p.file}`" for p in s.reads),
            ", ".join(f"`{p.file}`" for p in s.writes),
            ", ".join(f"`{section}`" for section in s.sections),
            f"`{s.where}`" if s.where else "",
        )
        for s in STAGES
    ]
    head = ("stage", "", "reads", "writes", "sections of the manifest", "only with")
    return _page(
        [
            "# Stages",
            (
                "A stage runs if its input, its output, one of its sections of the manifest, the"
                " seed or nearlift itself has changed."
            ),
            _table(head, rows),
        ]
    )


def nomenclature_page() -> str:
    """All symbols in one table."""
    rows = [
        (
            f"`{s.name}`",
            f"${s.latex}$",
            s.unit,
            s.meaning,
            f"${s.paper_symbol}$" if s.paper_symbol else "",
        )
        for s in SYMBOLS
    ]
    return _page(["# Nomenclature", _table(("name", "symbol", "unit", "meaning", "paper"), rows)])


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
        rows = [[f"[`{name}`]({name}.md)", described, third] for name, described, third in items]
        pages[f"{folder}/index.md"] = _page([f"# {title}", _table(["name", "", meaning], rows)])
    return pages | {"nomenclature.md": nomenclature_page(), "stages.md": stages_page()}


def _page(parts: Sequence[str]) -> str:
    return "\n\n".join(parts) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines
    )


def _range(valid: tuple[float, float]) -> str:
    low, high = valid
    return f"z_hat above {low:g}" + ("" if math.isinf(high) else f", up to {high:g}")


def _arguments(arguments: Mapping[str, object]) -> str:
    return ", ".join(
        f"{k} = {v:.6g}" if isinstance(v, int | float) else f"{k} given"
        for k, v in arguments.items()
    )
