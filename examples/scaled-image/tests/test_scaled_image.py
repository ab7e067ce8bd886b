import numpy as np
import pytest

from nearlift import catalogue
from scaled_image import MODEL


def test_it_is_in_the_catalogue_of_several_rotors():
    assert catalogue.model("scaled_image") is MODEL
    assert MODEL in catalogue.models("ground")
    assert "scaled_image" in catalogue.default_rivals("ground", 4, {})


def test_the_first_order_is_that_of_an_image():
    assert MODEL(20.0, k=3.0) - 1 == pytest.approx(3 / 80**2, rel=1e-3)


def test_nothing_is_said_below_the_pole():
    assert np.isnan(MODEL(0.5, k=4.0))
    assert MODEL(np.array([1.0, 2.0]), k=np.array([[0.0], [1.0]])).shape == (2, 2)
