"""Every model against its printed formula, written again in extended precision."""

import numpy as np
import pytest

from nearlift.models import MODELS

#: On some processors it is a double, and rounds as often as the models do.
L = np.longdouble
WORST = 4e-16 if np.finfo(L).eps < 1e-18 else 4e-15
Z = np.geomspace(0.6, 30, 400)
D, B, EDGE, GAP, TILT = L(65) / 23, L(92) / 23, L(1.5), L(40), L(0.125)
ROTORS = [(x * D / 2, y * D / 2) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
KNOWN = {
    "spacing_hat": float(D),
    "diagonal_hat": float(B),
    "layout_hat": np.array(ROTORS, dtype=float),
    "gap_hat": float(GAP),
    "edge_hat": float(EDGE),
    "tilt_rad": float(TILT),
}


def apart(i, j):
    return np.hypot(i[0] - j[0], i[1] - j[1])


def image(height, h):
    return height / 4 / (h**2 + height**2) ** L(1.5)


def level(z, i, j):
    return image(2 * z, apart(i, j))


def edge(z, i, j):
    e = EDGE - (i[0] + j[0]) / 2
    t = e / np.sqrt(e**2 + z**2 + apart(i, j) ** 2 / 4)
    return (L(1) / 2 + 3 * t / 4 - t**3 / 4) * image(2 * z, apart(i, j))


def tilted(z, i, j):
    z_i, z_j = (z + rotor[0] * np.sin(TILT) for rotor in (i, j))
    h = np.hypot((i[0] - j[0]) * np.cos(TILT), i[1] - j[1])
    return np.cos(TILT) / 4 * 2 * z_j / (h**2 + (z_i + z_j) ** 2) ** L(1.5)


def corridor(z, i, j, kappa):
    h, total = apart(i, j), level(z, i, j)
    for n in range(1, 17):
        far = 2 * n * GAP
        total = total + kappa**n * (
            image(far + 2 * z, h) + image(far - 2 * z, h) - 2 * image(far, h)
        )
    return total


def mean_over_rotors(share):
    return lambda z, **values: sum(
        1 / (1 - sum(share(z, i, j, **values) for j in ROTORS)) / 4 for i in ROTORS
    )


def four_images(z):
    return 1 / (16 * z**2) + sum(z / (k * (k * D**2 + 4 * z**2) ** L(1.5)) for k in (1, 2))


def sanchez_cuevas(z, K_b):
    return 1 / (1 - four_images(z) - 2 * K_b * z / (B**2 + 4 * z**2) ** L(1.5))


def as_printed(z, inverse_K_b):
    return 1 / (1 - four_images(z) - inverse_K_b * z / (2 * (D**2 + 4 * z**2) ** L(1.5)))


def cheeseman_bennett(z, k=1):
    return 1 / (1 - k / (16 * z**2))


def gamma(z, alpha):
    return L(1) / 2 + np.sqrt(1 + alpha / z**2) / 2


def exponential(z, a, b):
    return 1 + a * np.exp(-b * z)


def power_law(z, a, p):
    return 1 + a * z**-p


FORMULAS = {
    "sanchez_cuevas": sanchez_cuevas,
    "sanchez_cuevas_published": lambda z: sanchez_cuevas(z, 2),
    "sanchez_cuevas_free_exponent": lambda z, K_b, n: sanchez_cuevas(z, K_b) ** n,
    "sanchez_cuevas_as_printed": as_printed,
    "images": mean_over_rotors(level),
    "images_tilted": mean_over_rotors(tilted),
    "images_edge": mean_over_rotors(edge),
    "corridor": mean_over_rotors(corridor),
    "cheeseman_bennett": cheeseman_bennett,
    "cheeseman_bennett_constant_power": lambda z, k: cheeseman_bennett(z, k) ** (L(2) / 3),
    "cheeseman_bennett_fixed": cheeseman_bennett,
    "hayden": lambda z: (L("0.9926") + L("0.0379") * (2 / z) ** 2) ** (L(2) / 3),
    "exponential": exponential,
    "power_law": power_law,
    "hsiao_chirarattananon": gamma,
    "hsiao_chirarattananon_constant_power": lambda z, alpha: gamma(z, alpha) ** (L(2) / 3),
    "hsiao_chirarattananon_free_exponent": lambda z, alpha, n: gamma(z, alpha) ** n,
    "ceiling_empirical": lambda z, c, e: 1 / (1 - c / (z + e) ** 2),
    "ceiling_exponential": exponential,
    "ceiling_power_law": power_law,
    "sidewall_decay": lambda z, a, lambda_: 1 - a * np.exp(-z / lambda_),
    "sidewall_power_law": lambda z, a, p: 1 - a * (1 + z) ** -p,
    "sidewall_none": np.ones_like,
}


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
def test_a_model_is_its_formula_to_rounding(model):
    for factor in (0.6, 1.0, 1.3):
        values = {p.name: factor * p.value for p in model.parameters}
        ratio = model.evaluate(Z, **values, **{n: KNOWN[n] for n in model.needs})
        formula = FORMULAS[model.name](Z.astype(L), **{k: L(v) for k, v in values.items()})
        assert np.abs(ratio / formula - 1).max() < WORST
