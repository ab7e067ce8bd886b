"""compare: one coefficient over many campaigns: a table, a forest plot, and a population fit that keeps what is shared shared.

No stage of a campaign's own: it reads what finished runs left under ``processed/`` and writes ``reports/comparison/``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearlift import store
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ProductError, UsageError
from nearlift.fitting.population import FEWEST, Population, population
from nearlift.lock import settled
from nearlift.products import DIAGNOSIS, FIT, NOT_DIAGNOSED, PROVENANCE
from nearlift.results import Estimate
from nearlift.summaries.forest import WIDTH_90
from nearlift.transaction import JOURNAL, Homes

FOLDER = "comparison"
#: Below this a p-value means no more than that.
LEAST_CHANCE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One campaign's headline coefficient at one boundary.

    Attributes
    ----------
    campaign, vehicle, boundary, model, coefficient : str
    before, after : Estimate
        By the fit, and after the loop (over its rivals, with their form uncertain; what has no name carried; the same where nothing was found).
    verdict : str
        Of the loop; ``not_diagnosed`` where it has not run as well.
    parts : dict of str to float
        What each declared component of scope boundary or campaign contributes to `after`, signed.
    """

    campaign: str
    vehicle: str
    boundary: str
    model: str
    coefficient: str
    before: Estimate
    after: Estimate
    verdict: str
    parts: dict[str, float]


def finished(out: Path, names: Sequence[str] = ()) -> list[Path]:
    """Folders of finished runs under `out`/processed: those of the campaigns named, else all.

    Raises
    ------
    UsageError
        There are none, or a named one has not been fitted.
    """
    home = out / "processed"
    for journal in home.glob(f"*/{JOURNAL}"):
        settled(Homes.of(out, journal.parent.name))
    if not names:
        found = sorted(path.parent for path in home.glob(f"*/{FIT.file}"))
        if not found:
            raise UsageError(str(home), "holds no fitted campaign", "`nearlift run CAMPAIGN` first, or say --out")
        return found
    missing = [name for name in names if not (home / name / FIT.file).is_file()]
    if missing:
        raise UsageError(str(home / missing[0]), f"is not fitted ({len(missing)} of {len(names)} campaigns)", "`nearlift run` them first")
    return [home / name for name in names]


def entries(folder: Path) -> list[Entry]:
    """The headline coefficient of every boundary of one finished run."""
    fitted = store.read_json(folder / FIT.file)
    if fitted.get("schema") != FIT.schema:
        raise ProductError(str(folder / FIT.file), f"has schema {fitted.get('schema')}", "it was written by another version: run again")
    found = store.read_json_if_whole(folder / DIAGNOSIS.file).get("boundaries", {})
    about = store.read_json_if_whole(folder / PROVENANCE.file)
    listed = []
    for boundary, base in fitted["base"].items():
        model = fitted["boundaries"][boundary][base]
        if not model["parameters"]:
            continue
        name = next(iter(model["parameters"]))
        before = Estimate.of(model["parameters"][name])
        loop = found.get(boundary, {})
        after = loop.get("coefficients", {}).get("after", {}).get(name)
        listed.append(
            Entry(
                campaign=folder.name,
                vehicle=about.get("vehicle", ""),
                boundary=boundary,
                model=base,
                coefficient=name,
                before=before,
                after=_after(after, before) if after and (loop["verdict"] == "effect" or loop["coefficients"].get("carried")) else before,
                verdict=loop.get("verdict", NOT_DIAGNOSED),
                parts=_shared_parts(model, name),
            )
        )
    return listed


def _after(found: dict[str, Any], before: Estimate) -> Estimate:
    u = (found["hi90"] - found["lo90"]) / WIDTH_90
    return Estimate(value=found["value"], u=u, lo90=found["lo90"], hi90=found["hi90"], unit=before.unit)


def _shared_parts(model: dict[str, Any], name: str) -> dict[str, float]:
    """Signed contribution of each component that is one unknown for the whole campaign."""
    lines = model.get("budget", {}).get(name, {}).get("lines", [])
    return {line["component"]: math.copysign(line["u"], line["sensitivity"]) for line in lines if line["scope"] in ("boundary", "campaign")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Entries that may stand beside each other, and what they say together (None: too few)."""

    boundary: str
    model: str
    coefficient: str
    entries: tuple[Entry, ...]
    together: Population | None


def grouped(listed: Sequence[Entry], shared: Sequence[str] = ()) -> tuple[Group, ...]:
    """Entries by boundary, base model and coefficient, each group with its population.

    Parameters
    ----------
    listed : sequence of Entry
    shared : sequence of str
        Names of components that are one and the same error in all campaigns (the same load cell, the same gauge block).

    Raises
    ------
    UsageError
        A name in `shared` is no campaign's component.
    """
    known = sorted({name for entry in listed for name in entry.parts})
    for name in shared:
        if name not in known:
            raise UsageError("--shared", f"no campaign has a component {name!r}", f"there are: {', '.join(map(repr, known)) or 'none'}")
    keys = sorted({(e.boundary, e.model, e.coefficient) for e in listed})
    groups = []
    for key in keys:
        own = tuple(e for e in listed if (e.boundary, e.model, e.coefficient) == key)
        # an interval over rivals is lopsided, and its best value no centre: the population is fitted to the interval
        value = np.array([(e.after.lo90 + e.after.hi90) / 2 for e in own])
        together = population(value, covariance(own, shared), own[0].after.unit) if len(own) >= FEWEST else None
        groups.append(Group(boundary=key[0], model=key[1], coefficient=key[2], entries=own, together=together))
    return tuple(groups)


def covariance(own: Sequence[Entry], shared: Sequence[str]) -> FloatArray:
    """Of the errors of these entries; what is shared stands off the diagonal too."""
    total: FloatArray = np.diag([e.after.u**2 for e in own])
    for name in shared:
        part = np.array([e.parts.get(name, 0.0) for e in own])
        if (part**2 > np.diag(total) * (1 + 1e-9)).any():
            raise InputRefused("--shared", f"{name!r} is larger than a campaign's whole uncertainty", "fit that campaign again")
        common = np.outer(part, part)
        np.fill_diagonal(common, 0.0)
        total += common
    return total


def run(out: Path, names: Sequence[str] = (), shared: Sequence[str] = (), look: str = "aiaa") -> dict[str, Any]:
    """Write ``reports/comparison/``: comparison.json, forest.pdf, .png and .csv, index.html, and answer what stands in the first."""
    from nearlift.figures import forest as draw_forest
    from nearlift.figures.render import render
    from nearlift.figures.style import style
    from nearlift.pages import comparison
    from nearlift.summaries import forest
    from nearlift.summaries.tidy import to_csv

    listed = [entry for folder in finished(out, names) for entry in entries(folder)]
    groups = grouped(listed, shared)
    content = {"schema": "nearlift.comparison/1", "shared": list(shared), "groups": [_told(group) for group in groups]}
    target = out / "reports" / FOLDER
    rows = forest.summarise(content)
    files = render(draw_forest.draw, rows, style(look))
    for kind in ("pdf", "png"):
        store.write_bytes(target / f"forest.{kind}", files[kind])
    store.write_bytes(target / "forest.csv", to_csv(rows))
    own = {str(name) for name in rows["label"] if (out / "reports" / str(name) / "index.html").is_file()}
    store.write_bytes(target / "index.html", comparison.page(rows, files["page"], own))
    store.write_json(target / "comparison.json", content)
    return content


def table(content: dict[str, Any]) -> list[str]:
    """comparison.json as lines of text."""
    from nearlift.rounding import like, plain

    lines = []
    for group in content["groups"]:
        lines.append(f"{group['boundary']}: {group['coefficient']} of {group['model']}")
        rows = [(own["campaign"], own["after"], own["verdict"]) for own in group["campaigns"]]
        together = group.get("population")
        if together:
            spread = together["spread"]
            words = f"spread {plain(spread['value'], 2)} (up to {plain(spread['hi90'], 2)}); no spread: {_chance(together['p_value'])}"
            rows += [("population mean", together["mean"], words), ("next campaign", together["next"], "")]
        wide = max(len(name) for name, _, _ in rows)
        for name, e, words in rows:
            value, low, high = (like(e[key], e["u"]) for key in ("value", "lo90", "hi90"))
            lines.append(f"  {name:<{wide}}  {value} ({low} to {high})  {words}".rstrip())
    return lines


def _chance(p: float) -> str:
    from nearlift.rounding import plain

    return f"p = {plain(p, 2)}" if p > LEAST_CHANCE else f"p < {LEAST_CHANCE:g}"


def _told(group: Group) -> dict[str, Any]:
    campaigns = [
        {
            "campaign": e.campaign,
            "vehicle": e.vehicle,
            "verdict": e.verdict,
            "before": _estimate(e.before),
            "after": _estimate(e.after),
            "in_population": _estimate(group.together.campaigns[i]) if group.together else None,
        }
        for i, e in enumerate(group.entries)
    ]
    told: dict[str, Any] = {"boundary": group.boundary, "model": group.model, "coefficient": group.coefficient, "campaigns": campaigns}
    if group.together is not None:
        p = group.together
        told["population"] = {
            "mean": _estimate(p.mean),
            "spread": _estimate(p.spread),
            "next": _estimate(p.next_value),
            "q": p.q,
            "dof": p.dof,
            "p_value": p.p,
            "spread_prior": {"distribution": "half-Cauchy", "scale": p.prior_scale},
        }
    return told


def _estimate(e: Estimate) -> dict[str, Any]:
    return {"value": e.value, "u": e.u, "lo90": e.lo90, "hi90": e.hi90, "unit": e.unit}
