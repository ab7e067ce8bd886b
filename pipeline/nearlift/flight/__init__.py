"""Flight near a boundary: crash rates, boundary detection, lift models for on-board software."""
