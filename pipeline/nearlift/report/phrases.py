"""Phrases of sentences: lists, covariates, p-values, verdicts, sizes with their units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

from markupsafe import Markup, escape

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.nomenclature import INDEXED, letter, noun
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.estimate import Estimate
from nearlift.results.quotation import UNEVEN, BoundaryResult, CoefficientResult, IdentifiedSize
from nearlift.rounding import like, plain, plus_minus

#: P-values below this are printed as a bound.
LEAST_P = 1e-12
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
EXPONENT = re.compile(r"(?<=\d)e([+-]\d{1,3})\b")
#: Condition of every probability that is printed; the odds are those of `loop.weigh`.
PRIOR_ODDS = (
    "Probabilities assume relative prior odds: 1 for all single effects together, 0.03 for"
    " structure without a known cause. No effect has 7.4, or 0.14 once the test shows structure."
)
#: Probability from which an explanation is named alone.
MIN_ALONE = 0.6
#: Explanations of at least this probability are listed, and at most so many.
MIN_LISTED, MAX_LISTED = 0.05, 4
#: Names in a sentence.
MOST_NAMES = 5
#: Effects with more sizes than this are printed as a range.
MOST_SIZES = 3
#: Factor and unit in which an SI quantity is printed.
SCALES = {"m": (1e3, "mm"), "N": (1e3, "mN"), "1": (1e2, "%")}
#: Covariates whose name is not the word for them.
ALONG = {
    "start": "time",
    "approach": "direction of approach",
    "supply": "supply voltage",
    "previous_lift_N": "previous lift",
    "previous_throttle": "previous throttle",
    "previous_distance": "previous distance",
    "order_in_visit": "order within a visit",
}
#: What an effect's size says of lift, by parameter; `{}` is the number.
SIZE_WORDS = {
    "sag_exponent": "lift scales as voltage^{}",
    "speed_exponent": "lift scales as rotor speed^{}",
    "density_exponent": "lift scales as air density^{}",
    "held_exponent": "the lift ratio has the exponent {}",
    "gap_hat2": "the gain of lift saturates below ẑ = {}",
}


def listed(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def several(names: Sequence[str], most: int = MOST_NAMES, last: str = "and") -> str:
    """``a, b, c and 9 others``: no more names than a sentence bears."""
    if len(names) > most:
        names = [*names[: most - 1], f"{len(names) - most + 1} others"]
    return listed(names, last)


def titles(names: Sequence[str], last: str = "and") -> str:
    """Effects and pairs of effects (``a + b``) by title, each once."""
    return listed([*dict.fromkeys(titled(n.replace(" + ", " with ")) for n in names)], last)


def counted(n: int, word: str) -> str:
    """``1 trial``, ``2 trials``."""
    return f"{n} {word}{'s' if n != 1 else ''}"


def sentence(text: str) -> str:
    """Text with titles for names, a capital and a full stop."""
    text = titled(text)
    if re.match(r"[a-z]{2}", text):
        text = text[0].upper() + text[1:]
    return text if not text or text.endswith(".") else f"{text}."


def spoken(text: str) -> str:
    """A text of a product with titles for names and words for covariates; a percent sign stays with
    its number.
    """
    text = re.sub(r"\b(?:alpha|gamma|lambda_)(?!\w)", lambda m: letter(m[0]), titled(text))
    text = re.sub(r"\balong (\w+)", lambda m: f"along {along(m[1])}", text)
    text = re.sub(r"\b(order_in_visit|previous_[a-z]+(_N)?)\b", lambda m: along(m[0]), text)
    return text.replace("z_hat", "ẑ").replace(" %", "\N{NO-BREAK SPACE}%")


def typeset(text: str) -> Markup:
    """Spoken text as HTML, letters with their index as symbols and exponents raised."""
    indexed = INDEXED.sub(r"<i>\1</i><sub>\2</sub>", str(escape(spoken(text))))
    return Markup(re.sub(r"\^(−?\d[\d.]*\b)", r"<sup>\1</sup>", indexed))


def along(covariate: str) -> str:
    """A covariate in words."""
    return ALONG.get(covariate, covariate.replace("_", " "))


def chance(p: float) -> str:
    """``p = 0.02``, ``p = 3 × 10⁻⁶``, or ``p < 10⁻¹²``."""
    return f"p = {raised(plain(p, 1))}" if p > LEAST_P else "p < 10⁻¹²"


def raised(text: str) -> str:
    """``−3 × 10⁻⁶ per mN`` for ``-3e-06 per mN``."""
    powers = EXPONENT.sub(lambda e: f" × 10{str(int(e[1])).translate(RAISED)}", text)
    return powers.replace("-", "−")


def coverage(coefficient: str) -> str:
    """Meaning of ± after a coefficient, which may itself be called k."""
    return "one standard uncertainty" if coefficient == "k" else "k = 1"


# verdicts


def is_sure(quoted: BoundaryResult) -> bool:
    """Whether the identified effects are named alone; also where no probability was computed."""
    return quoted.probability is None or quoted.probability >= MIN_ALONE


def probability(quoted: BoundaryResult) -> str:
    """`` (probability 96 %)`` of the verdict; empty where none was computed, and for effects that
    are not named alone.
    """
    p = quoted.probability
    if p is None or (quoted.effects and not is_sure(quoted)):
        return ""
    return f" (probability {f'{100 * p:.0f}' if p < 0.995 else '> 99'} %)"


def explanation(quoted: BoundaryResult, diagnosis: BoundaryDiagnosis | None) -> str:
    """The identified effects by title; below a probability of `MIN_ALONE` ``one of: supply sag
    48 %, session gain 39 %, other 13 %``.
    """
    weighed = diagnosis.probabilities if diagnosis else ()
    if is_sure(quoted) or not weighed:
        return titles(quoted.effects)
    likely = [w for w in weighed if w.other is None and w.probability >= MIN_LISTED]
    likely = sorted(likely, key=lambda w: -w.probability)[:MAX_LISTED]
    names = [
        f"unexplained structure along {along(w.nameless)}"
        if w.nameless
        else titled(" with ".join(w.effects)) or "no effect"
        for w in likely
    ]
    shares = [round(100 * w.probability) for w in likely]
    if sum(shares) < 100:
        names, shares = [*names, "other"], [*shares, 100 - sum(shares)]
    return f"one of: {', '.join(f'{n} {s} %' for n, s in zip(names, shares, strict=True))}"


def forms(quoted: BoundaryResult) -> str:
    """`` (near-wall saturation in its soft form)`` where an identified effect has several forms and
    is named alone; else empty.
    """
    known = (quoted.forms or {}) if is_sure(quoted) else {}
    each = [f"{titled(effect)} in its {form} form" for effect, form in known.items()]
    return f" ({listed(each)})" if each else ""


def claim(quoted: BoundaryResult, diagnosis: object) -> str:
    """The verdict in a word, with the explanation: ``effect: supply sag``."""
    known = diagnosis if isinstance(diagnosis, BoundaryDiagnosis) else None
    verdict = quoted.verdict.replace("_", " ")
    return f"{verdict}: {explanation(quoted, known)}" if quoted.effects else verdict


def structure_along(diagnosis: BoundaryDiagnosis | None) -> str:
    """Covariates of significant structure, the first two by name; else the first of all."""
    structure = diagnosis.structure if diagnosis else ()
    shown = [s for s in structure if s.significant] or structure[:1]
    every = [along(s.covariate) for s in shown]
    return listed(every if len(every) < 3 else [*every[:2], "others"])


def dependence(quoted: BoundaryResult) -> str:
    """The single visit or trial that verdict or headline depend on; empty where there is none."""
    if quoted.most_influential is None:
        return ""
    kind, moved = quoted.most_influential
    headline = quoted.coefficients[quoted.headline]
    trial = headline.influence.trial
    # other verdicts, by the trial or visit without which they are given
    turned, also = "", ""
    for name, on in (("trial", quoted.rests_on), ("visit", quoted.rests_on_visit)):
        if not on or on.verdict == quoted.verdict:
            continue
        other = on.verdict + (f" ({' and '.join(on.effects)})" if on.effects else "")
        if (name, on.moved.id) == (kind, moved.id):
            turned = other
        else:
            place = (trial if trial and trial.id == on.trial else on.moved).place
            also += f" Without {name} {place} the verdict is {other}."
    where = f"{kind} {moved.place}"
    if abs(moved.shift) <= headline.u:
        without = f"without it, it is {turned or quoted.verdict}"
        return f"The verdict depends on {where}: {without}.{also}"
    to = like(headline.value + moved.shift, headline.u)
    change = ("+" if moved.shift > 0 else "") + plain(moved.shift, 2)
    other = f"the verdict is {turned} and " if turned else ""
    value = f"{noun(quoted.headline)} is {to} ({change})"
    if moved.shift_per_mm is not None:
        value += f"; 0.1 mm in its distance shifts it by {plain(abs(0.1 * moved.shift_per_mm), 2)}"
    return f"The answer depends on {where}: without it {other}{value}.{also}"


def implausible(quoted: BoundaryResult) -> list[str]:
    """A warning of each coefficient whose 90 % interval lies beyond its usual values."""
    known = quoted.coefficients
    return [
        f"{noun(p.name)} = {plain(known[p.name].value, 3)} lies beyond its usual values,"
        f" {p.plausible[0]:g} to {p.plausible[1]:g}: another effect may have its shape"
        for p in catalogue.model(quoted.base_model).parameters
        if p.name in known
        and (known[p.name].hi90 < p.plausible[0] or known[p.name].lo90 > p.plausible[1])
    ]


def random_walk(size: float) -> str:
    """The sentence on a gain that drifts by this fraction of lift along no logged quantity."""
    return (
        f"the gain drifts irregularly by {100 * size:.2g} % of lift over the campaign,"
        " along nothing that was logged"
    )


# numbers


def is_even(c: Estimate | CoefficientResult) -> bool:
    """Whether ``± u`` describes the 90 % interval: one answer's, with equal arms."""
    below, above = c.value - c.lo90, c.hi90 - c.value
    return getattr(c, "answers", 1) == 1 and abs(above - below) <= UNEVEN * (above + below)


def coefficient_text(c: Estimate | CoefficientResult, name: str = "") -> str:
    """``K_b = 2.06 ± 0.08 (90 %: 1.93 to 2.19)``, rounded where the uncertainty begins.

    Without ± where the interval is uneven, without ``K_b =`` where there is no name.
    """
    known = math.isfinite(c.u) and c.u > 0
    value = plus_minus(c.value, c.u) if is_even(c) else like(c.value, c.u)
    unit = f" {c.unit}" if c.unit != "1" else ""
    ends = f" (90 %: {like(c.lo90, c.u)} to {like(c.hi90, c.u)})" if known else ""
    bound = ", at a bound" if c.at_bound else ""
    return f"{f'{letter(name)} = ' if name else ''}{value}{unit}{ends}{bound}"


def displayed(parameter: str, unit: str) -> tuple[Callable[[float], float], str]:
    """Conversion of an effect's size for print, and its unit: millimetres, millinewtons or per cent
    of lift. A fitted squared distance, `gap_hat2`, is printed as a distance.
    """
    head, comma, tail = unit.partition(", ")
    if parameter == "gap_hat2":
        return (lambda x: math.sqrt(max(x, 0.0))), ""
    if head.startswith("fraction of "):
        return (lambda x: 100 * x), f"% of {head.removeprefix('fraction of ')}{comma}{tail}"
    quantity, per, rest = head.partition("/")
    if quantity not in ("m", "N"):
        return float, "" if unit == "1" else unit
    factor, shown = SCALES[quantity]
    return (lambda x: factor * x), f"{shown}{per}{rest}"


def without_unit(parameter: str, unit: str) -> str:
    """An effect's parameter without the unit that ends its name: ``zero`` of ``zero_N_per_K``."""
    spelled = unit.partition(", ")[0].replace("1/", "per_").replace("/", "_per_")
    return parameter.removesuffix(f"_{spelled}")


def sizes(quoted: BoundaryResult, radius_m: float) -> str:
    """Sizes of the identified effects: ``lift scales as voltage^2.03 (90 %: 1.95 to 2.10). Over the
    trials it changes lift by 4.9 %``; effects by title where there are several.
    """
    parts = []
    for effect in dict.fromkeys(s.effect for s in quoted.sizes):
        mine = [s for s in quoted.sizes if s.effect == effect]
        if len(mine) > MOST_SIZES:
            show, unit = displayed(mine[0].parameter, mine[0].unit)
            u = (show(mine[0].hi90) - show(mine[0].lo90)) / 3.3
            ends = [like(show(x(s.value for s in mine)), u) for x in (min, max)]
            text = f"{len(mine)} values from {ends[0]} to {ends[1]} {unit}".rstrip()
        else:
            text = ", ".join(_size(s, radius_m) for s in mine)
        text += f". Over the trials it changes lift by {plain(mine[0].lift_percent, 2)} %"
        parts.append(sentence(f"{effect}: {text}") if len(quoted.effects) > 1 else text)
    return " ".join(parts).removesuffix(".")


def _size(size: IdentifiedSize, radius_m: float) -> str:
    """One size with its unit and 90 % interval."""
    show, unit = displayed(size.parameter, size.unit)
    each = [show(x) for x in (size.value, size.lo90, size.hi90)]
    u = (each[2] - each[1]) / 3.3
    value, low, high = (like(x, u) for x in each)
    if size.parameter == "gap_hat2":
        mm, low, high = (like(1e3 * radius_m * x, 1e3 * radius_m * u) for x in each)
        value += f", {mm} mm"
    ends = f"(90 %: {low} to {high})"
    if words := SIZE_WORDS.get(size.parameter):
        return f"{words.format(value)} {ends}"
    name = letter(without_unit(size.parameter, size.unit)).replace("_", " ")
    return f"{name} {value} {unit}".rstrip() + f" {ends}"
