"""Flight near a boundary: crash rates, detection, models that a vehicle can carry."""
