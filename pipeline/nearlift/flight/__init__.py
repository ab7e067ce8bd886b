"""Flight near a boundary: crash rates, boundary detection, lift models for on-board software."""

from collections.abc import Callable

from nearlift.declare import FloatArray

#: L / L_inf as a function of z_hat, of its shape.
Ratio = Callable[[FloatArray], FloatArray]
