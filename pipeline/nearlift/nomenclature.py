"""Every symbol, once: its name in code and files, how it is set, its unit, its meaning, and the
paper's symbol.

Columns of products, axis labels and documentation read this table. Names carry the unit (`z_m`,
`lift_N`); a hat means scaled by rotor radius; `u_` in front of a name is one standard uncertainty
of it.
"""

from __future__ import annotations

import csv
import difflib
import html
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from nearlift.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Symbol:
    """One quantity.

    Attributes
    ----------
    name : str
        As columns and keywords spell it.
    latex : str
        As figures and pages set it, without dollars.
    unit : str
        SI, ``"1"`` if dimensionless, empty for what is no number.
    meaning : str
        One phrase, with sign and datum where they matter.
    paper_symbol : str
        The symbol of Carter, Bouchard and Quinn 2021 in LaTeX; empty where the paper has none.
    """

    name: str
    latex: str
    unit: str
    meaning: str
    paper_symbol: str = ""


#: Outcomes measured with lift, each with its standard uncertainty. They are averaged and drawn;
#: no model is fitted to them.
CARRIED = {
    "roll_moment_Nm": "u_roll_moment_Nm",
    "pitch_moment_Nm": "u_pitch_moment_Nm",
    "wall_force_N": "u_wall_force_N",
}

#: A letter with an index in a text, as ``K_b``.
INDEXED = re.compile(r"\b([A-Za-z])_([a-z]+)\b")
#: What the loop says of a campaign, in words; empty where it has not run.
VERDICTS = {
    "not_diagnosed": "not diagnosed",
    "adequate": "adequate",
    "effect": "effect identified",
    "unexplained": "unexplained structure",
}

#: What effects call the covariate along which they vary, in the schedule's words.
SCHEDULE_WORDS = {
    "z_hat": "distance",
    "supply_V": "supply",
    "temperature_K": "temperature",
    "tilt_rad": "tilt",
    "speed_hat": "rpm",
    "start_s": "start",
    "since_start_s": "start",
    "elapsed_hat": "start",
    "inverted": "orientation",
    "turn_rad": "turn",
    "other_propeller": "propeller",
    "fountain_side": "fountain",
}


def _symbols() -> tuple[Symbol, ...]:
    with Path(__file__).with_name("symbols.csv").open(newline="", encoding="utf-8") as file:
        return tuple(Symbol(**row) for row in csv.DictReader(file))


#: All symbols: ``symbols.csv``.
SYMBOLS = _symbols()
_BY_NAME = {s.name: s for s in SYMBOLS}
#: A letter under a hat, and a Greek one, in LaTeX.
HAT, GREEK = re.compile(r"\\hat\{(\w)\}"), re.compile(r"\\([a-z]+)")


def latex(name: str) -> str:
    """LaTeX of a name, without dollars; a name without a symbol is unchanged."""
    return _BY_NAME[name].latex if name in _BY_NAME else name


def letter(coefficient: str) -> str:
    """A coefficient's symbol in plain text, as captions have it, such as ``α``, ``ĉ`` or ``K_b``;
    its name, if it has no such symbol.
    """
    text = HAT.sub("\\1\N{COMBINING CIRCUMFLEX ACCENT}", latex(coefficient))
    text = GREEK.sub(lambda m: html.unescape(f"&{m[1]};"), unicodedata.normalize("NFC", text))
    if not set(text).isdisjoint("\\{&"):
        text = coefficient
    head = text.partition("_")[0]
    return text if len(head) == 1 or "/" in head else text.replace("_", " ").strip()


def noun(coefficient: str) -> str:
    """Its letter within a sentence, where a bare a would be read as an article."""
    said = letter(coefficient)
    return f"coefficient {said}" if said.isascii() and len(said) == 1 else said


def mathematics(coefficient: str) -> str:
    """A coefficient's name between dollars, as LaTeX, Markdown and figures set it; one without a
    letter in words.
    """
    if coefficient in _BY_NAME:
        return f"${latex(coefficient)}$"
    head, _, index = letter(coefficient).partition("_")
    return (f"${head}_{{{index}}}$" if index else f"${head}$") if len(head) == 1 else head


def symbol(name: str) -> Symbol:
    """The symbol of that name; a name beginning with `u_` is one standard uncertainty of the rest.

    Raises
    ------
    UsageError
        There is none; the nearest names are proposed.
    """
    if name in _BY_NAME:
        return _BY_NAME[name]
    if name.startswith("u_") and name[2:] in _BY_NAME:
        of = _BY_NAME[name[2:]]
        return Symbol(
            name=name,
            latex=f"u({of.latex})",
            unit=of.unit,
            meaning=f"standard uncertainty of {of.name}: {of.meaning}",
        )
    near = difflib.get_close_matches(name, _BY_NAME, n=3)
    raise UsageError(
        "symbol",
        f"there is no symbol {name!r}",
        f"did you mean {' or '.join(near)}?" if near else "`nearlift describe` lists them",
    )


def label(name: str, unit: str | None = None) -> str:
    r"""Axis label such as ``$z$ (m)`` or ``$\hat{z}$``; `unit` replaces the SI unit where a figure
    draws another, such as ``"%"``.
    """
    known = symbol(name)
    shown = known.unit if unit is None else unit
    return f"${known.latex}$" if shown in ("", "1") else f"${known.latex}$ ({shown})"
