"""A lift model with parameters held, or raised to the exponent of a held quantity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare.declaration import LiftModel, with_keywords
from nearlift.declare.parameter import Parameter


def variant(
    model: LiftModel,
    *,
    held: Mapping[str, float] | None = None,
    exponent: float | Parameter = 1.0,
    **declared: Any,
) -> LiftModel:
    """Model with some parameters held at values, its ratio raised to a power.

    Parameters
    ----------
    held
        Parameters by name that are no longer free.
    exponent
        Power of L / L_inf: a number, or a further free parameter.
    declared
        Name, title, formula, source, checks, and other fields that differ.
    """
    held = held or {}
    power = exponent if isinstance(exponent, Parameter) else None
    parameters = tuple(p for p in model.parameters if p.name not in held)
    parameters += (power,) if power else ()
    names = (*model.needs, *(p.name for p in parameters))

    def evaluate(z_hat: Any, /, **values: Any) -> Any:
        n = values.pop(power.name) if power else exponent
        ratio = model.evaluate(z_hat, **values, **held)
        return ratio if isinstance(n, float) and n == 1.0 else np.asarray(ratio) ** n

    def downwash(z_hat: Any, /, **values: Any) -> Any:
        # at the same thrust, whatever the exponent
        n = values.pop(power.name) if power else 1.0
        assert model.downwash is not None
        return model.downwash(z_hat, **values, **held) * np.ones_like(n)

    return replace(
        model,
        evaluate=with_keywords(evaluate, names),
        downwash=with_keywords(downwash, names) if model.downwash else None,
        parameters=parameters,
        **declared,
    )
