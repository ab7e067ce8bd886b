"""One effect's explanation as a table to draw, and as text for the console."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np

from nearlift.loop.foresight import Handle
from nearlift.loop.search import Stage
from nearlift.summaries.design import SHOWN, size_text
from nearlift.summaries.evidence import Columns

#: What a session or a setting is called along the axis.
OWN = ("z_hat", "throttle", "session")


def rows(
    stage: Stage,
    handle: Handle,
    boundary: str,
    found: dict[str, Any],
    raw: Any,
    left: Any,
    confused: list[dict[str, Any]],
) -> Columns:
    """The figure's rows for one size at one boundary.

    `panel` is signature, power or confused; a signature's `y` is per cent of lift against the
    effect's own covariate `x`, a power's a chance against size, a confusion's the share of energy
    that `series` takes over, with the chance of being a rival as `x`.
    """
    data, effect = stage.data, handle.effect
    name = effect.varies_with
    own = {"z_hat": data.z_hat, "throttle": 100 * data.throttle, "session": data.session + 1.0}
    x = np.asarray(own[name] if name in own else data.covariates[name], dtype=float)
    finite = np.isfinite(x)
    parts = [
        ("signature", "raw", x[finite], 100 * raw[finite]),
        ("signature", "left", x[finite], 100 * left[finite]),
        ("signature", "noise", np.array([np.nan]), np.array([100 * _typical(stage)])),
    ]
    power = found["power"]
    unit, factor = SHOWN.get(handle.parameter.unit, (handle.parameter.unit, 1.0))
    if power is not None:
        size = factor * np.asarray(power["size"])
        parts += [
            ("power", key, size, np.asarray(power[key])) for key in ("seen", "within", "alone")
        ]
        parts.append(
            ("power", "false alarm", np.array([np.nan]), np.array([stage.options.false_alarm_rate]))
        )
    if found["detection_limit"] is not None:
        parts.append(
            ("power", "limit", np.array([factor * found["detection_limit"]]), np.array([0.8]))
        )
    parts += [
        ("confused", c["effect"], np.array([c["rival_chance"]]), np.array([c["energy_absorbed"]]))
        for c in confused
    ]
    panel, series, xs, ys = zip(*parts, strict=True)
    count = [len(v) for v in xs]
    total = sum(count)

    def text(value: str) -> Any:
        return np.full(total, value, dtype=object)

    return {
        "boundary": text(boundary),
        "effect": text(effect.title),
        "parameter": text(handle.parameter.name),
        "unit": text(unit),
        "size": np.full(total, factor * found["shown_size"]),
        "covariate": text(name),
        "panel": np.repeat(np.array(panel, dtype=object), count),
        "series": np.repeat(np.array(series, dtype=object), count),
        "x": np.concatenate(xs),
        "y": np.concatenate(ys),
    }


def _typical(stage: Stage) -> float:
    """Scatter of one trial about any curve, rms over trials."""
    from nearlift.likelihood.noise import floor

    return floor(stage.data, stage.noise, stage.slope)


def text(found: dict[str, Any]) -> str:
    """The explanation in words, its numbers from `found`."""
    source = found["source"]
    cited = "; ".join(
        x
        for x in (
            source["citation"],
            source["equation"] and f"equation {source['equation']}",
            source["doi"],
        )
        if x
    )
    lines = [
        f"{found['effect']}: {found['title']}",
        "",
        *_wrap(f"Mechanism: {found['mechanism']} (acts on {found['acts_on']})."),
    ]
    lines += [
        "",
        *found["notes_of_declaration"].strip().splitlines(),
        "",
        *_wrap(f"Source: {cited}."),
    ]
    lines += [line for doubt in source["doubts"] for line in _wrap(f"Doubt: {doubt}")]
    for boundary, at in found["boundaries"].items():
        lines += ["", f"In {found['campaign']}, {boundary}", ""]
        lines += _boundary(at, found)
    lines += [line for note in found["notes"] for line in ("", *_wrap(f"Not looked at: {note}"))]
    if found["files"]:
        lines += ["", *found["files"]]
    return "\n".join(lines) + "\n"


def _boundary(at: dict[str, Any], found: dict[str, Any]) -> list[str]:
    if not at["testable"]:
        if at.get("reason"):
            return _wrap(f"Not a candidate here: {at['reason']}.")
        return _wrap(
            f"Untestable: {', '.join(at['needs'])} {'are' if len(at['needs']) > 1 else 'is'}"
            " unknown, or did not vary. Log next time:"
            f" {', '.join(at['log_next_time']) or 'more of the same'}, and let it vary."
        )
    noise = at["noise"]
    lines = _wrap(
        f"{at['trials']} trials about {at['base_model']}; noise {100 * noise['relative']:.2g} % of"
        f" lift, {1e3 * noise['force_N']:.2g} mN, {1e3 * noise['height_m']:.2g} mm per visit;"
        f" false-alarm rate {at['false_alarm_rate']:g}, for all tests together."
    )
    lines += _here(at["in_this_campaign"], found["effect"])
    if "within_trial" in at:
        w = at["within_trial"]
        return lines + _wrap(
            "It acts within a record and leaves no mark on trial means. "
            + (
                f"A mean change of {100 * w['limit']:.2g} % of lift over a record would be seen"
                " with 80 % chance."
                if w
                else "Records are unknown here."
            )
        )
    for size in at["sizes"]:
        lines += ["", *_size(size, at)]
    return lines


def _here(verdict: dict[str, Any] | None, name: str) -> list[str]:
    if verdict is None:
        return _wrap(
            "The loop has not run on this campaign (`nearlift diagnose CAMPAIGN`); the noise is"
            " that of its own trials."
        )
    if verdict["named"]:
        with_rivals = (
            f", with the rivals {', '.join(verdict['rivals'])}"
            if verdict["rivals"]
            else ", without a rival"
        )
        return _wrap(f"The loop named it here{with_rivals}.")
    if verdict["rival_of"]:
        return _wrap(
            "The loop lists it here among what this design cannot tell from"
            f" {', '.join(verdict['rival_of'])}."
        )
    tried = verdict["tried"]
    if tried and not tried["accepted"]:
        left = (
            f"it leaves structure in {tried['left_in']}"
            if tried.get("left_in")
            else "it earns too little"
        )
        return _wrap(
            f"The loop tried it here and did not accept it: {left}. Verdict: {verdict['verdict']}."
        )
    return _wrap(f"The loop had no need of it here. Verdict: {verdict['verdict']}.")


def _size(s: dict[str, Any], at: dict[str, Any]) -> list[str]:
    unit = s["unit"]
    shape = ", ".join(f"{k} = {v:g}" for k, v in s["shape"].items())
    head = f"{s['parameter']}{f' (with {shape})' if shape else ''}: {s['meaning']}."
    lines = _wrap(head)
    if at["share_visible"] <= 1e-4:
        lines += _wrap(
            "Silent: the model's coefficients and L_inf absorb it wholly. No number of trials of"
            " this kind can show it."
        )
    elif s["detection_limit"] is None:
        lines += _wrap(
            f"Even the largest possible size, {size_text(s['largest_size'], unit)}, is not seen"
            f" with 80 % chance (seen with {100 * s['power']['seen'][-1]:.0f} %)."
        )
    else:
        ratio = s["detection_limit"] / s["plausible_size"]
        lines += _wrap(
            "Detection limit (80 % power):"
            f" {size_text(s['detection_limit'], unit)}"
            f"{' rms over sessions' if s['per'] == 'session' else ''},"
            f" which is {ratio:.2g} times its plausible size of"
            f" {size_text(s['plausible_size'], unit)}."
        )
        named = s["limit_named_alone"]
        lines += _wrap(
            "Among the names or their rivals with 80 % chance from"
            f" {_or(s['limit_within_set'], unit)}; named alone from {_or(named, unit)}. "
            + (
                "(With so few visits the loop decides by what it predicts of a visit left out, so"
                " take the chances to be named as upper ends.)"
                if at["few_visits"]
                else (
                    "(Before held-out visits have their say, which lowers the chances of weak"
                    " effects.)"
                )
            )
        )
    sig = s["signature"]
    lines += _wrap(
        f"At {size_text(s['shown_size'], unit)} it changes lift by {100 * sig['rms']:.2g} % (rms"
        f" over trials), of which {100 * sig['rms_left']:.2g} % are left when the coefficients and"
        f" L_inf have absorbed what they can (at most {100 * sig['largest_left']:.2g} % in one"
        " trial)."
    )
    for name, b in s["bias"].items():
        units = f"{abs(b['in_u']):.2g} of its standard uncertainty"
        lines += _wrap(
            f"Unnoticed at that size it shifts {name} = {b['value']:.3g} by {b['shift']:+.2g},"
            f" {units}."
        )
    rivals = [
        c for c in s["confused_with"] if c["rival_chance"] >= 0.05 or c["energy_absorbed"] >= 0.5
    ][:8]
    if rivals:
        lines += [
            (
                "Confused with (correlation after theta and L_inf; energy it takes over; chance to"
                " be named or a rival at that size):"
            )
        ]
        lines += [
            f"  {c['effect']:<22} r = {c['correlation']:.3f}   {100 * c['energy_absorbed']:3.0f} % "
            f"  {100 * c['rival_chance']:3.0f} %"
            for c in rivals
        ]
    elif at["share_visible"] > 1e-4:
        lines += ["Confused with nothing in the library."]
    return lines


def _or(value: float | None, unit: str) -> str:
    return "beyond any size looked at" if value is None else size_text(value, unit)


def _wrap(text: str) -> list[str]:
    return textwrap.wrap(text, 110)
