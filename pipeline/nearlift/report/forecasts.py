"""Forecasts as text for the console: the outlook of a design, and the account of one effect."""

from __future__ import annotations

import textwrap

from nearlift import catalogue
from nearlift.results.design import BoundaryOutlook, DesignOutlook
from nearlift.results.explanation import (
    EffectAccount,
    EffectAtBoundary,
    EffectSize,
    EffectVerdict,
    EffectWithinTrial,
    NoCandidate,
)

#: Displayed units of sizes that are small in SI.
SHOWN = {"m": ("mm", 1e3), "N": ("mN", 1e3), "N/K": ("mN/K", 1e3), "N/m": ("mN/m", 1e3)}


def size_text(value: float, unit: str) -> str:
    """A size with its unit, in millimetres and millinewtons where these are handier."""
    shown, factor = SHOWN.get(unit, ("" if unit == "1" else unit, 1.0))
    return f"{factor * value:.3g} {shown}".strip()


def wrap(text: str) -> list[str]:
    """Lines of a console's text."""
    return textwrap.wrap(text, 110)


# a design


def design(outlook: DesignOutlook) -> str:
    """The outlook in words."""
    lines = [f"{outlook.campaign}: a plan from {outlook.plan}"]
    lines += [line for said in outlook.assumed for line in wrap(f"Assumed: {said}.")]
    for boundary, at in outlook.boundaries.items():
        lines += ["", f"{boundary}: {at.trials} trials about {at.base_model}", ""]
        lines += _design_boundary(at)
    lines += [line for note in outlook.notes for line in ("", *wrap(f"Not weighed: {note}"))]
    s = outlook.schedule
    lines += [
        "",
        *wrap(
            f"Random schedule (seed {s.seed}): {s.trials} trials at {s.visits} visits in"
            f" {s.sessions} sessions, about {s.hours:.1f} h; {100 * s.from_afar:.0f} % of"
            f" visits arrive moving towards the boundary, {s.detours} drive past their station"
            " first (column via). Times are planned ones: put the true ones in."
        ),
        s.file,
        "Copy it into the campaign's folder as trials.csv; nothing is written there.",
        "",
        *(outlook.files or ()),
    ]
    return "\n".join(lines) + "\n"


def _design_boundary(at: BoundaryOutlook) -> list[str]:
    noise = at.expected_noise
    lines = wrap(
        f"Noise ({noise.source}): {100 * noise.relative:.2g} % of lift,"
        f" {1e3 * noise.force_N:.2g} mN, {1e3 * noise.height_m:.2g} mm per visit. False-alarm"
        f" rate {at.false_alarm_rate:g}, for all tests together."
    )
    for name, c in at.coefficients.items():
        lines += wrap(
            f"Expected: {name} = {c.expected:.3g} +- {c.u:.2g}; with every effect of"
            f" plausible size unnoticed, +- {c.u_with_undetected_effects:.2g}."
        )
    columns = f"  {'effect':<22} {'limit':>12} {'plausible':>12} {'seen':>5} {'alone':>6}  verdict"
    lines += ["", columns]
    for row in at.effects:
        size, unit = row.detection_limit, row.unit
        limit = "never" if size is None else size_text(size, unit)
        plausible = size_text(row.plausible_size, unit)
        chances = f"{100 * row.seen:4.0f}% {100 * row.alone:5.0f}%"
        lines.append(f"  {row.label:<22} {limit:>12} {plausible:>12} {chances}  {row.verdict}")
    meant = (
        "  limit: size seen with 80 % chance; seen, alone: chances at the plausible size (alone:"
        " named without a rival)"
    )
    lines += ["", meant, ""]
    hidden = [r for r in at.effects if r.hidden]
    first = next(iter(at.coefficients), None)
    if first is not None and hidden:
        worst = sorted(hidden, key=lambda r: -abs(r.bias[first].in_u))[:3]
        biases = "; ".join(
            f"{r.label} of {size_text(r.hides_up_to, r.unit)}: {r.bias[first].shift:+.2g}"
            for r in worst
        )
        lines += wrap(f"Bias of {first} by what this plan would not see: {biases}.")
    lines += [line for unknown in at.limits for line in wrap(unknown.text)]
    for group in at.groups:
        lines += wrap(f"Confounded: {', '.join(group)}.")
    for lacking in at.untestable:
        if lacking.log_next_time:
            lines += wrap(f"Untestable: {lacking.effect}; log {', '.join(lacking.log_next_time)}.")
    if not at.groups:
        lines += ["", "Nothing that would be detected is confounded with anything else."]
    return lines


# one effect


def effect(explanation: EffectAccount) -> str:
    """The explanation in words."""
    declared = catalogue.effect(explanation.effect)
    source = declared.source
    equation = source.equation and f"equation {source.equation}"
    cited = "; ".join(filter(None, (source.citation, equation, source.doi)))
    acts_on = declared.acts_on + (", additive" if declared.additive else "")
    lines = [
        f"{declared.name}: {declared.title}",
        "",
        *wrap(f"Mechanism: {declared.mechanism} (acts on {acts_on})."),
        "",
        *declared.notes.strip().splitlines(),
        "",
        *wrap(f"Source: {cited}."),
    ]
    lines += [line for doubt in source.doubts for line in wrap(f"Doubt: {doubt}")]
    for boundary, at in explanation.boundaries.items():
        lines += ["", f"In {explanation.campaign}, {boundary}", ""]
        lines += _effect_boundary(at)
    lines += [line for note in explanation.notes for line in ("", *wrap(f"Not looked at: {note}"))]
    if explanation.files:
        lines += ["", *explanation.files]
    return "\n".join(lines) + "\n"


def _effect_boundary(at: EffectAtBoundary) -> list[str]:
    if isinstance(at, NoCandidate):
        if at.reason:
            return wrap(f"Not a candidate here: {at.reason}.")
        return wrap(
            f"Untestable: {', '.join(at.needs)} {'are' if len(at.needs) > 1 else 'is'}"
            " unknown, or did not vary. Log next time:"
            f" {', '.join(at.log_next_time) or 'more of the same'}, and let it vary."
        )
    noise = at.noise
    lines = wrap(
        f"{at.trials} trials about {at.base_model}; noise {100 * noise.relative:.2g} % of"
        f" lift, {1e3 * noise.force_N:.2g} mN, {1e3 * noise.height_m:.2g} mm per visit;"
        f" false-alarm rate {at.false_alarm_rate:g}, for all tests together."
    )
    lines += wrap(_here(at.in_this_campaign))
    if isinstance(at, EffectWithinTrial):
        seen = "Records are unknown here."
        if w := at.within_trial:
            seen = (
                f"A mean change of {100 * w.limit:.2g} % of lift over a record would be seen with"
                " 80 % chance."
            )
        return lines + wrap(f"It acts within a record and leaves no mark on trial means. {seen}")
    for size in at.sizes:
        lines += ["", *_size(size, at.few_visits)]
    return lines


def _here(verdict: EffectVerdict | None) -> str:
    """Result of the loop on the effect in this campaign."""
    if verdict is None:
        return (
            "The loop has not run on this campaign (`nearlift diagnose CAMPAIGN`); the noise is"
            " that of its own trials."
        )
    rivals, rival_of = ", ".join(verdict.rivals), ", ".join(verdict.rival_of)
    if verdict.named:
        beside = f"with the rivals {rivals}" if rivals else "without a rival"
        return f"The loop named it here, {beside}."
    if rival_of:
        return f"The loop lists it here as a rival of {rival_of}."
    said, tried = "had no need of it here", verdict.tried
    if tried and not tried.accepted:
        covariate = tried.left_in
        left = f"leaves structure in {covariate}" if covariate else "earns too little"
        said = f"tried it here and did not accept it: it {left}"
    return f"The loop {said}. Verdict: {verdict.verdict}."


def _size(s: EffectSize, few_visits: bool) -> list[str]:
    unit = s.unit
    shape = ", ".join(f"{k} = {v:g}" for k, v in s.shape.items())
    head = f"{s.parameter}{f' (with {shape})' if shape else ''}: {s.meaning}."
    lines = wrap(head)
    if s.power is None:
        lines += wrap(
            "Silent: the model's coefficients and L_inf absorb it wholly. No number of trials of"
            " this kind can show it."
        )
    elif s.detection_limit is None:
        lines += wrap(
            f"Even the largest possible size, {size_text(s.largest_size, unit)}, is not seen"
            f" with 80 % chance (seen with {100 * s.power.seen[-1]:.0f} %)."
        )
    else:
        ratio = s.detection_limit / s.plausible_size
        per = " rms over sessions" if s.per == "session" else ""
        lines += wrap(
            f"Detection limit (80 % power): {size_text(s.detection_limit, unit)}{per}, which is"
            f" {ratio:.2g} times its plausible size of {size_text(s.plausible_size, unit)}."
        )
        chances = "Before held-out visits have their say, which lowers the chances of weak effects."
        if few_visits:
            chances = (
                "With so few visits the loop decides by predictions of visits left out: the chances"
                " to be named are upper limits."
            )
        within, alone = (
            "beyond any size looked at" if limit is None else size_text(limit, unit)
            for limit in (s.limit_within_set, s.limit_named_alone)
        )
        lines += wrap(
            f"Among the names or their rivals with 80 % chance from {within}; named alone from"
            f" {alone}. ({chances})"
        )
    sig = s.signature
    lines += wrap(
        f"At {size_text(s.shown_size, unit)} it changes lift by {100 * sig.rms:.2g} % (rms"
        f" over trials), of which {100 * sig.rms_left:.2g} % are left when the coefficients and"
        f" L_inf have absorbed what they can (at most {100 * sig.largest_left:.2g} % in one"
        " trial)."
    )
    for name, b in s.bias.items():
        lines += wrap(
            f"Unnoticed at that size it shifts {name} = {b.value:.3g} by {b.shift:+.2g},"
            f" {abs(b.in_u):.2g} of its standard uncertainty."
        )
    rivals = [c for c in s.confused_with if c.rival_chance >= 0.05 or c.energy_absorbed >= 0.5][:8]
    if rivals:
        lines.append(
            "Confused with (correlation after theta and L_inf; energy it takes over; chance to be"
            " named or a rival at that size):"
        )
        lines += [
            f"  {c.effect:<22} r = {c.correlation:.3f}   {100 * c.energy_absorbed:3.0f} % "
            f"  {100 * c.rival_chance:3.0f} %"
            for c in rivals
        ]
    elif s.power:
        lines += ["Confused with nothing in the library."]
    return lines
