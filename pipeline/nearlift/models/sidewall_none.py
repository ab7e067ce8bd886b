"""Sidewall: no change of lift, as the images predict.

    L / L_inf = 1

The image of a rotor in a wall is at the same height. A source there moves no air along the rotor's
axis, so at first order lift does not change. A sidewall model that cannot beat this one has found
nothing.

Convention: z_hat is the gap between the wall and the nearest blade tip over rotor radius.

Approximation: potential flow. Wake, entrainment and recirculation are left out; a measured loss
must come from them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Source


def evaluate(z_hat: Any, /) -> Any:
    """L / L_inf, 1 everywhere; the shape of `z_hat`."""
    return np.ones_like(np.asarray(z_hat, dtype=float))


MODEL = LiftModel(
    name="sidewall_none",
    title="No change",
    formula=r"\frac{L}{L_\infty} = 1",
    evaluate=evaluate,
    boundary="sidewall",
    source=Source(
        citation="Own derivation from the image source of Cheeseman and Bennett",
        bibtex=("cheeseman1955",),
        doubts=("First order only.",),
    ),
    checks=(Check(x=0.3, expected=1.0, tolerance=0.0, quoted_by="own derivation"),),
    notes=__doc__ or "",
)
