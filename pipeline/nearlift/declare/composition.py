"""A lift model with effects added, which is again a lift model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from nearlift.declare.declaration import Declaration, Effect, LiftModel, keywords, with_keywords
from nearlift.errors import DeclarationError


def compose(model: LiftModel, *effects: Effect) -> LiftModel:
    """A lift model with effects added; it is again a lift model, so nothing downstream learns that
    effects exist.

    Downwash is changed by effects on the inflow alone: the model's, divided by their change of the
    ratio.

    Height effects act on z_hat before the model, ratio effects on its result, force effects on the
    product with L_inf. Their parameters keep their names; two effects with a parameter of the same
    name are refused. An effect's need of `z_hat` is met by the composition itself, with the height
    effects applied, and is no need of the result.
    """
    additive = any(e.additive for e in effects)
    parameters = model.parameters + tuple(p for e in effects for p in e.parameters)
    if len({p.name for p in parameters}) != len(parameters):
        raise DeclarationError(
            f"compose({model.name}, ...)", "two of the parts have a parameter of the same name"
        )
    needs = dict.fromkeys(model.needs)
    needs |= dict.fromkeys(n for e in effects for n in e.needs if n != "z_hat")
    if additive:
        needs["lift_inf_N"] = None
    by_kind = {
        kind: [e for e in effects if e.acts_on == kind] for kind in ("height", "ratio", "force")
    }
    asked = {part.name: keywords(part.evaluate) for part in (model, *effects)}

    def arguments(part: Declaration, values: Mapping[str, object], z_hat: Any) -> dict[str, object]:
        known = {**values, "z_hat": z_hat}
        return {name: known[name] for name in asked[part.name]}

    def evaluate(z_hat: Any, /, **values: Any) -> Any:
        for effect in by_kind["height"]:
            z_hat = effect.evaluate(z_hat, **arguments(effect, values, z_hat))
        ratio = model.evaluate(z_hat, **arguments(model, values, z_hat))
        for effect in by_kind["ratio"]:
            ratio = effect.evaluate(ratio, **arguments(effect, values, z_hat))
        lift_inf = values["lift_inf_N"] if additive else 1.0
        lift = ratio * lift_inf
        for effect in by_kind["force"]:
            lift = effect.evaluate(lift, **arguments(effect, values, z_hat))
        return lift / lift_inf

    def downwash(z_hat: Any, /, **values: Any) -> Any:
        assert model.downwash is not None
        for effect in by_kind["height"]:
            if effect.inflow:
                z_hat = effect.evaluate(z_hat, **arguments(effect, values, z_hat))
        known = arguments(model, values, z_hat)
        before = after = model.evaluate(z_hat, **known)
        for effect in by_kind["ratio"]:
            if effect.inflow:
                after = effect.evaluate(after, **arguments(effect, values, z_hat))
        return model.downwash(z_hat, **known) * (before / after)

    null = {p.name: p.value for e in effects for p in e.parameters}
    extra = {n: 1.0 for n in needs if n not in model.needs}
    checks = tuple(replace(c, arguments={**c.arguments, **null, **extra}) for c in model.checks)
    names = (*needs, *(p.name for p in parameters))
    return LiftModel(
        name="_with_".join((model.name, *(e.name for e in effects))),
        title=" + ".join((model.title, *(e.title for e in effects))),
        formula=model.formula,
        evaluate=with_keywords(evaluate, names),
        parameters=parameters,
        needs=tuple(needs),
        valid_z_hat=model.valid_z_hat,
        source=model.source,
        checks=checks,
        boundary=model.boundary,
        rotors=model.rotors,
        downwash=with_keywords(downwash, names) if model.downwash else None,
        tends_to_one=model.tends_to_one,
    )
