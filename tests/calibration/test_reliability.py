"""The joint test passes calibrated probabilities and fails overconfident ones."""

import numpy as np
from tests.calibration.reliability import drawn, reliability, stacked


def campaigns(n, sharpened):
    """Rows of three explanations whose truth follows their probabilities before `sharpened`."""
    rng = np.random.default_rng(5)
    rows = []
    for _ in range(n):
        chance = rng.dirichlet([1.0, 1.0, 1.0])
        stated = chance**sharpened / np.sum(chance**sharpened)
        effects = [["supply_sag"], ["warm_up"], []]
        listed = [
            {"effects": e, "probability": float(p)} for e, p in zip(effects, stated, strict=True)
        ]
        rows.append({"truth": effects[rng.choice(3, p=chance)], "probabilities": listed})
    return rows


def test_the_joint_test_knows_calibrated_from_overconfident():
    assert reliability(campaigns(200, 1.0))["p_value"] > 0.01
    assert reliability(campaigns(200, 4.0))["p_value"] < 0.01


def test_at_most_one_explanation_of_a_campaign_is_drawn():
    rows = campaigns(50, 1.0)
    probability, _, campaign = stacked(rows)
    truth = drawn(probability, campaign, np.random.default_rng(0)).reshape(50, 4)
    assert np.array_equal(truth.sum(axis=1), np.ones(50))
    assert not truth[:, 0].any()


def test_a_probability_is_better_than_a_name():
    found = reliability(campaigns(100, 1.0))
    assert found["brier"] < found["brier_of_best_name"]
    assert sum(b["n"] for b in found["bins"]) == 400
