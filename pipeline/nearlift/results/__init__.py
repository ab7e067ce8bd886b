"""Results of the cores, typed once: computed, saved as JSON, loaded and shown."""

from nearlift.declare import IntArray
from nearlift.results.estimate import Estimate, Noise
from nearlift.results.observations import Observations

__all__ = ["Estimate", "IntArray", "Noise", "Observations"]
