"""nearlift: near-boundary lift of tethered rotorcraft, from load-cell records to models with honest uncertainty."""

__version__ = "0.1.0"
