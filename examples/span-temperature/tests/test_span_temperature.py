import numpy as np
import pytest

from nearlift import catalogue
from nearlift.declare import compose
from span_temperature import EFFECT


def test_it_is_in_the_catalogue():
    assert EFFECT in catalogue.effects()


def test_a_model_with_it_is_again_a_model():
    model = compose(catalogue.model("power_law"), EFFECT)
    warm = model(
        2.0, temperature_K=np.array([293.0, 303.0]), temperature_ref_K=293.0, span_per_K=0.001
    )
    assert warm[1] / warm[0] == pytest.approx(1.01)
